"""The command line. Everything slow to import is imported inside the commands: --help answers at once."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperGroup

from sed2cad import __version__
from sed2cad.brep.worker import warm_up
from sed2cad.console import Progress, counter, print_summary
from sed2cad.errors import AssemblyError, Sed2cadError, UsageError
from sed2cad.evaluation import commands
from sed2cad.files import require_folder, require_writable
from sed2cad.process import run_and_end, uncollected

MAIN_JOB = "reconstruct"
OWN_OPTIONS = ("--help", "--version")
Command = TypeVar("Command", bound=Callable[..., None])


class ScanFirst(TyperGroup):
    """`sed2cad scan.ply` is `sed2cad reconstruct scan.ply`: so with any first word that is no command."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in OWN_OPTIONS:
            args = [MAIN_JOB, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(cls=ScanFirst, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
evaluate = typer.Typer(no_args_is_help=True, help="Score the parts of the pipeline on true parts.")
app.add_typer(evaluate, name="evaluate")

Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print errors only.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="List all faces and constraints; trace errors.")]


def main() -> None:
    """Entry point of the `sed2cad` script."""
    run_and_end(app)


def reported(command: Command) -> Command:
    """What goes wrong becomes one sentence on stderr and the exit code of the error."""

    @functools.wraps(command)
    def run(*args: Any, **options: Any) -> None:
        try:
            command(*args, **options)
        except (typer.Exit, typer.Abort):
            raise
        except KeyboardInterrupt:
            fail("stopped by the user; files that were there before are as they were", 130)
        except ModuleNotFoundError as error:
            if error.name != "torch":
                raise
            fail("this command trains networks and needs torch: pip install 'sed2cad[train]'", UsageError.exit_code)
        except Sed2cadError as error:
            show_traceback(options)
            fail(str(error), error.exit_code)
        except Exception as error:
            show_traceback(options)
            sentence = f"{type(error).__name__}: {error}".splitlines()[0].rstrip(".")
            fail(f"this is a bug, please report it with the scan and the output of -v ({sentence})", 1)

    return run  # type: ignore[return-value]


def fail(sentence: str, code: int) -> None:
    """Say it on stderr and end."""
    print(f"sed2cad: {sentence}", file=sys.stderr)
    raise typer.Exit(code)


def show_traceback(options: dict[str, Any]) -> None:
    """With -v only."""
    if options.get("verbose"):
        import traceback

        traceback.print_exc()


def show_version(wanted: bool) -> None:
    """--version"""
    if wanted:
        print(f"sed2cad {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Scan to STEP: `sed2cad scan.ply --step part.step` makes a closed, editable solid of a scanned part.

    `sed2cad reconstruct --help` lists the options of this main job; its name may be left out.
    """


@app.command(MAIN_JOB)
@reported
def reconstruct_command(
    scan: Annotated[Path, typer.Argument(help="Points or mesh: .ply .stl .obj .xyz .txt .csv .npy .npz")],
    step: Annotated[Path | None, typer.Option(help="STEP file to write. (default: SCAN's name.step)")] = None,
    report: Annotated[Path | None, typer.Option(help="Model and report to write, as JSON.")] = None,
    script: Annotated[Path | None, typer.Option(help="Python script to write, which makes the part.")] = None,
    unit: Annotated[str, typer.Option(metavar="mm|cm|m|in", help="Unit of the scan's coordinates.")] = "mm",
    tolerance: Annotated[
        float | None, typer.Option(help="Largest distance of points and their faces. (default: by the noise)")
    ] = None,
    regularize: Annotated[
        bool, typer.Option("--regularize/--no-regularize", help="Make parallel, equal, ... what nearly is.")
    ] = True,
    round_: Annotated[
        float | None, typer.Option("--round", help="Dimensions become multiples of it where the points allow.")
    ] = None,
    cap: Annotated[bool, typer.Option("--cap", help="Close the part with flat faces where the scan ends.")] = False,
    allow_open: Annotated[
        bool, typer.Option("--allow-open", help="An open shell is a success where the scan does not show all.")
    ] = False,
    seed: Annotated[int, typer.Option(help="The same scan and seed give the same solid.")] = 0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Make a closed solid of a scan (the main job)."""
    from sed2cad.scan.read import reader_of
    from sed2cad.settings import Settings

    settings = Settings(
        seed=seed, regularize=regularize, round=round_, tolerance=tolerance, cap=cap, unit=unit
    )
    reader_of(scan)
    step = step or scan.with_suffix(".step")
    document = report or (step.with_suffix(".json") if script else None)
    require_outputs({"--step": step, "--report": document, "--script": script}, scan)
    warm_up()  # the CAD kernel loads in a process of its own meanwhile
    with uncollected():
        from sed2cad.pipeline import reconstruct

    progress = Progress(quiet)
    model = reconstruct(scan, settings, progress)
    model.export_step(step)
    if document:
        model.save(document)
    if script and document:
        model.write_script(script, document)
    progress("write", ", ".join(str(path) for path in (step, document, script) if path))
    if not quiet:
        print_summary(model, step, progress.total, verbose)
    if model.open_at and not allow_open:
        raise AssemblyError(
            f"{scan.name}: the scan does not show all of the part, and {step} holds a shell that is open there; "
            "close it flat with --cap or accept it with --allow-open"
        )
    if not model.report.closed and not model.open_at:
        raise AssemblyError(f"{scan.name}: no closed solid could be built; {step} holds an open shell")


@app.command("vary")
@reported
def vary_command(
    model: Annotated[Path, typer.Argument(help="The JSON file that --report wrote.")],
    set_: Annotated[list[str], typer.Option("--set", help="Like cylinder_3.radius=6, once or more often.")],
    step: Annotated[Path, typer.Option(help="STEP file to write.")],
    report: Annotated[Path | None, typer.Option(help="The variant's model to write, as JSON.")] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Change dimensions of a reconstructed part and solve its edges again."""
    changes = parse_changes(set_)
    require_outputs({"--step": step, "--report": report}, model)
    from sed2cad.model import CadModel

    progress = Progress(quiet)
    variant = CadModel.load(model).vary(**changes)
    variant.export_step(step)
    if report:
        variant.save(report)
    if not quiet:
        print_summary(variant, step, progress.total, verbose)


@app.command("dataset")
@reported
def dataset_command(
    folder: Annotated[Path, typer.Argument(help="Folder of .step, .stp and .brep files.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the packed parts.")],
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Pack CAD files, with the truth about their surfaces and edges, to train on."""
    require_folder(folder)
    from sed2cad.training.dataset import build_dataset

    made = build_dataset(folder, out, workers, counter("dataset", quiet))
    for path, reason in made.skipped.items() if verbose else ():
        print(f"skipped {path}: {reason}", file=sys.stderr)
    if not quiet:
        print(f"{out}: {made}")
    if not made.packed:
        raise UsageError(f"{folder}: no .step, .stp or .brep file in it could be used; choose another folder")


@app.command("synthetic")
@reported
def synthetic_command(
    count: Annotated[int, typer.Argument(min=1, help="Parts to make.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the .brep files; those there are kept.")],
    seed: Annotated[int, typer.Option(min=0, help="Number of the first part; a number is always the same part.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Make random mechanical parts, to train on."""
    from sed2cad.training.synthetic import write_parts

    made = write_parts(out, count, seed, workers, counter("synthetic", quiet))
    for path, reason in made.failed.items() if verbose else ():
        print(f"failed {path}: {reason}", file=sys.stderr)
    if not quiet:
        print(f"{out}: {len(made.parts)} parts, {len(made.failed)} failed")


@app.command("train")
@reported
def train_command(
    data: Annotated[list[Path], typer.Argument(help="Folders that `sed2cad dataset` made, real parts first.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder of the run; a run that is there goes on.")],
    preset: Annotated[str, typer.Option(metavar="default|paper", help="For two cores, or as the paper.")] = "default",
    minutes: Annotated[float | None, typer.Option(help="The learning rate falls to 0 over this time.")] = None,
    wall: Annotated[bool, typer.Option(help="Minutes of the clock, not of the processor.")] = False,
    learning_rate: Annotated[float | None, typer.Option(help="The highest one.")] = None,
    init: Annotated[Path | None, typer.Option(help="Weights to start from.")] = None,
    threads: Annotated[int, typer.Option(min=1)] = 1,
    seed: Annotated[int, typer.Option()] = 0,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Train the network; under torchrun in several processes."""
    from dataclasses import replace

    from sed2cad.training.dataset import parts_in
    from sed2cad.training.settings import PRESETS
    from sed2cad.training.train import train

    for folder in data:
        parts_in(folder)
    if preset not in PRESETS:
        raise UsageError(f"there is no preset {preset}; choose one of {', '.join(PRESETS)}")

    def tell(row: dict[str, float]) -> None:
        if not quiet:
            line = ", ".join(f"{name} {value:g}" for name, value in row.items())
            print(f"train      {line}", file=sys.stderr, flush=True)

    given = {"minutes": minutes, "learning_rate": learning_rate}
    changes: Any = {name: value for name, value in given.items() if value is not None}
    settings = replace(PRESETS[preset](), init=init, wall=wall, threads=threads, seed=seed, **changes)
    best = train(settings, data, out, tell)
    if not quiet:
        print(f"{best}: best weights")


for command in (commands.segmentation, commands.ablation, commands.fitting, commands.assembly):
    evaluate.command(command.__name__)(reported(command))


def parse_changes(settings: list[str]) -> dict[str, dict[str, Any]]:
    """["cylinder_3.radius=6"] to {"cylinder_3": {"radius": 6.0}}; three numbers with commas make a vector."""
    changes: dict[str, dict[str, Any]] = {}
    for setting in settings:
        target, equals, text = setting.partition("=")
        primitive, dot, parameter = target.strip().partition(".")
        try:
            numbers = tuple(float(word) for word in text.split(","))
        except ValueError:
            numbers = ()
        if not (equals and dot and primitive and parameter and numbers):
            raise UsageError(f"cannot understand --set {setting}: write it like cylinder_3.radius=6")
        changes.setdefault(primitive, {})[parameter] = numbers if len(numbers) > 1 else numbers[0]
    return changes


def require_outputs(outputs: dict[str, Path | None], source: Path) -> None:
    """UsageError before the work when an output could not be written after it, or two are one file."""
    seen = {source.resolve(): "the input"}
    for option, path in outputs.items():
        if path is None:
            continue
        if option == "--step" and path.suffix.lower() not in (".step", ".stp"):
            raise UsageError(f"{path}: --step writes STEP files; give it a name that ends in .step")
        require_writable(option, path)
        if path.resolve() in seen:
            raise UsageError(f"{path}: {option} would overwrite {seen[path.resolve()]}; choose another name")
        seen[path.resolve()] = f"the output of {option}"
