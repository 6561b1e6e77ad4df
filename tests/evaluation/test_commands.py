import json

import pytest
from typer.testing import CliRunner

from sed2cad.cli import app
from tests.evaluation.clouds import box


def run(*words):
    """Exit code, stdout and stderr."""
    result = CliRunner().invoke(app, ["evaluate", *map(str, words)])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    for index in range(2):
        box(1 - 0.2 * index).save(folder / f"box_{index}.npz")
    return folder


def test_all_methods_on_two_parts(parts, tmp_path):
    code, out, err = run("segmentation", parts, "--points", 1_200, "--json", tmp_path / "scores.json")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()[:4]] == ["method", "network", "refined", "growing"]
    assert [line.split()[0] for line in out.splitlines()[5:]] == [
        "type", "plane", "cylinder", "cone", "sphere", "torus", "bspline",
    ]  # fmt: skip
    assert "2 of 2: box_1" in err
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert scores["settings"]["points"] == 1_200
    assert [(row["part"], row["method"]) for row in scores["parts"]] == [
        (part, method) for part in ("box_0", "box_1") for method in ("network", "refined", "growing")
    ]
    refined, growing = scores["methods"][1:]
    assert refined["p_miou_strict"] > 0.95 and refined["t_miou"] == 1 and refined["failed"] == 0
    assert growing["p_miou_strict"] > 0.99 and growing["t_miou"] is None  # a lone point in a corner is a crumb
    assert all(row["peak_mb"] > 50 for row in scores["parts"])


def test_two_workers_give_the_same_rows(parts, tmp_path):
    rows = []
    for workers in (1, 2):
        file = tmp_path / f"{workers}.json"
        words = ("--method", "growing", "--points", 600, "--noise", 0.005, "--workers", workers, "-q")
        code, _, err = run("segmentation", parts, *words, "--json", file)
        assert (code, err) == (0, "")
        rows.append(json.loads(file.read_text())["parts"])
    same = ("part", "method", "p_miou", "p_miou_strict", "p_miou_large", "edge", "classes", "error")
    assert [[row[name] for name in same] for row in rows[0]] == [[row[name] for name in same] for row in rows[1]]


def test_a_part_that_is_no_scan_counts_as_unlabelled(parts, tmp_path):
    box(0.0).save(tmp_path / "flat.npz")
    code, out, _ = run("segmentation", tmp_path, "--points", 600, "--method", "growing", "-q")
    assert code == 0
    assert "growing: failed on 1 of 1 parts" in out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("segmentation", "nowhere"), "nowhere: there is no such folder"),
        (("segmentation", "{tmp}"), "there are no packed parts in it"),
        (("segmentation", "{parts}", "--method", "magic"), "unknown method 'magic': it must be one of network, ref"),
        (("segmentation", "{parts}", "--json", "{tmp}/no/where.json"), "there is no folder"),
        (("segmentation", "{parts}", "--json", "{tmp}"), "this is a folder; give --json a file name"),
    ],
)
def test_usage(parts, tmp_path, words, sentence):
    code, _, err = run(*(word.format(tmp=tmp_path, parts=parts) for word in words))
    assert code == 2
    assert sentence in err and err.startswith("sed2cad: ")
