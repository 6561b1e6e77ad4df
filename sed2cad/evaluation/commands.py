"""The commands below `sed2cad evaluate`; what is slow to import is imported inside."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from sed2cad.files import require_writable, write_text

Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Trace errors.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")]
Json = Annotated[Path | None, typer.Option("--json", help="File for all rows and the settings.")]


def segmentation(
    data: Annotated[Path, typer.Argument(metavar="PARTS", help="Folder that `sed2cad dataset` made.")],
    method: Annotated[
        list[str] | None, typer.Option(help="network, refined, growing; once or more often. (default: all)")
    ] = None,
    points: Annotated[int, typer.Option(min=100, help="Points of each part.")] = 10_000,
    noise: Annotated[float, typer.Option(min=0, help="Noise in radii of the part; the paper's: 0.04.")] = 0.0,
    limit: Annotated[int | None, typer.Option(min=1, help="Only the first of the parts.")] = None,
    weights: Annotated[Path | None, typer.Option(help="Weights to score. (default: those shipped)")] = None,
    json: Json = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes, of one thread each.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of points, noise and clustering.")] = 0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Score patches, types and edge points: the paper's metrics and strict ones.

    network: the network's clusters alone; refined: the pipeline's patches; growing: region growing on normals.
    """
    if json:
        require_writable("--json", json)
    from sed2cad.evaluation.methods import METHODS
    from sed2cad.evaluation.segmentation import SegmentationSettings, evaluate_segmentation
    from sed2cad.evaluation.tables import segmentation_json, segmentation_text

    def tell(done: int, total: int, part: str, seconds: float) -> None:
        if not quiet:
            print(f"segmentation  {done} of {total}: {part}  {seconds:.1f} s", file=sys.stderr, flush=True)

    methods = tuple(dict.fromkeys(method or METHODS))
    settings = SegmentationSettings(methods, points, noise, limit, weights, workers, seed)
    result = evaluate_segmentation(data, settings, progress=tell)
    print(segmentation_text(result))
    if json:
        write_text(json, segmentation_json(result))


def ablation(
    data: Annotated[Path, typer.Argument(help="Folder of labelled parts to train on.")],
    val: Annotated[Path, typer.Argument(help="Folder of labelled parts to score.")],
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="RUNS", help="Folder of the runs; what has ended in it is kept.")
    ],
    steps: Annotated[int, typer.Option(min=1, help="Of each training.")] = 450,
    seeds: Annotated[int, typer.Option(min=1, help="Trainings of each row.")] = 1,
    points: Annotated[int, typer.Option(min=300, max=10_000, help="Of each cloud, trained on and scored.")] = 3_000,
    parts: Annotated[int, typer.Option(min=4, help="Trained on.")] = 400,
    limit: Annotated[int, typer.Option(min=1, help="Parts of VAL that are scored.")] = 24,
    threads: Annotated[int, typer.Option(min=1)] = 1,
    json: Json = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Train the network without each of its ideas, under equal conditions (the paper's Table 4)."""
    if json:
        require_writable("--json", json)
    from sed2cad.evaluation.ablation import AblationSettings, ablation_json, ablation_text, run_ablation

    def tell(sentence: str) -> None:
        if not quiet:
            print(f"ablation  {sentence}", file=sys.stderr, flush=True)

    settings = AblationSettings(steps, seeds, points, parts=parts, validation_parts=limit, threads=threads)
    runs = run_ablation(data, val, out, settings, tell)
    print(ablation_text(runs))
    if json:
        write_text(json, ablation_json(settings, runs))


def fitting(
    parts: Annotated[
        Path | None, typer.Argument(metavar="PARTS", help="Folder of packed parts, or of CAD files, to fit as well.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Of each cell; a fifth of it for kinds and B-splines.")] = 50,
    workers: Annotated[int, typer.Option(min=1, help="Processes, of one thread each.")] = 2,
    json: Json = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Fit surfaces that are known: errors over the Cramer-Rao bound, kinds, B-splines, seconds.

    Noise 0.02, 0.1, 0.5 % of the size; 100, 500, 5,000 points; 360 to 45 degrees; 0, 10, 20 % outliers: all of them.
    Kinds are chosen without outliers; B-splines are whole, with 0 and 20 %. Of PARTS the B-spline patches are fitted
    without noise, and it is counted which relations between their faces come out of a noisy scan.
    """
    if json:
        require_writable("--json", json)
    from sed2cad.evaluation.fitting import FittingSettings, evaluate_fitting
    from sed2cad.evaluation.fitting_tables import fitting_json, fitting_text

    def tell(done: int, total: int, seconds: float) -> None:
        if not quiet and (done % 20 == 0 or done == total):
            print(f"fitting  {done} of {total} cells  {seconds:.0f} s", file=sys.stderr, flush=True)

    result = evaluate_fitting(FittingSettings(seeds, workers), parts, progress=tell)
    print(fitting_text(result))
    if json:
        write_text(json, fitting_json(result))


def assembly(
    parts: Annotated[Path, typer.Argument(metavar="PARTS", help="Folder of .step, .stp and .brep files.")],
    labels: Annotated[str, typer.Option(metavar="true|network", help="Where the patches come from.")],
    kind: Annotated[str, typer.Option(metavar="clean|noisy|dense|mesh|table", help="Of the scans.")] = "clean",
    limit: Annotated[int | None, typer.Option(min=1, help="So many parts, evenly spread over the names.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Parts at a time, each on one thread.")] = 1,
    timeout: Annotated[float, typer.Option(min=1, help="Seconds for each reconstruction.")] = 180.0,
    json: Json = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Scan CAD files, reconstruct them and score the solids: closed, solved, exact, and why not.

    true: the patches are those of the true faces, so that only fits and assembly are scored; network: the whole
    pipeline. A crash or a hang is a row, never the end of the run.
    """
    if json:
        require_writable("--json", json)
    from sed2cad.evaluation.assembly import AssemblySettings, PartRow, evaluate_assembly
    from sed2cad.evaluation.assembly_tables import assembly_json, assembly_text

    def tell(done: int, total: int, row: PartRow) -> None:
        if not quiet:
            verdict = "exact" if row.exact else ", ".join(row.causes)
            told = f"{row.part}  {verdict}  {row.seconds:.1f} s"
            print(f"assembly  {done} of {total}: {told}", file=sys.stderr, flush=True)

    settings = AssemblySettings(labels, kind, limit, workers, timeout)
    rows = evaluate_assembly(parts, settings, progress=tell)
    print(assembly_text(rows))
    if json:
        write_text(json, assembly_json(settings, rows))
