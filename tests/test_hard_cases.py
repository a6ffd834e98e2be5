"""All hard cases by all methods: each as right as it was measured, or excused and as wrong.

`softshadow.scenes.hard` has the cases; ``python benches/hard.py`` prints what is compared here.
"""

from __future__ import annotations

import functools
import math
import re
from pathlib import Path

import numpy as np
import pytest
import softshadow as ss
from softshadow import cli
from softshadow.scenes.hard_cases.case import MARGIN, RIGHT, ROUNDING

HARD = ss.scenes.hard
PAGE = Path(__file__).parents[1] / "docs" / "hard_cases.md"


@functools.cache
def _answer(name):
    return HARD[name].answer()


def _render(name, method):
    setup = _answer(name).setup
    return ss.render(setup.scene, setup.camera, setup.lights, method)


@pytest.mark.parametrize("method", HARD.methods)
@pytest.mark.parametrize("name", HARD)
def test_every_method_is_as_right_as_it_was_measured_or_excused_and_as_wrong(name, method):
    case, answer = HARD[name], _answer(name)
    excuse = case.excuses.get(method)
    if excuse is not None and excuse.raises is not None:
        with pytest.raises(excuse.raises, match=method):
            _render(name, HARD.methods[method])
        return
    image = _render(name, HARD.methods[method])
    assert np.array_equal(image.triangle_id, answer.image.triangle_id)
    assert np.isfinite(image.radiance).all()
    assert image.visibility.min() >= 0
    assert image.visibility.max() <= 1
    error = answer.error(image)
    assert error <= case.tolerance(method)
    if excuse is not None:
        # An excuse that is no longer needed goes, and its measured error with it.
        assert error >= case.measured[method] / MARGIN


@pytest.mark.parametrize("name", HARD)
def test_a_method_is_excused_where_it_is_wrong_and_nowhere_else(name):
    case = HARD[name]
    assert set(case.excuses) <= set(ss.method_names())
    for method in ss.method_names():
        excuse, error = case.excuses.get(method), case.measured.get(method)
        if error is None:
            assert excuse is not None, method
            assert excuse.raises is not None, method
        else:
            assert (excuse is not None) == (error > RIGHT), (method, error)
            assert excuse is None or excuse.raises is None
            assert case.tolerance(method) == max(MARGIN * error, ROUNDING)
    # The reference is right everywhere.
    assert case.measured["ray_traced"] < RIGHT


def test_what_was_measured_is_of_these_cases_and_methods():
    table = (Path(ss.scenes.hard_cases.__file__).parent / "measured.csv").read_text().splitlines()
    assert table[0].split(",") == ["scene", *ss.method_names()]
    assert [row.split(",")[0] for row in table[1:]] == list(HARD)


def test_the_page_has_all_cases_with_what_is_hard():
    rows = re.findall(r"^\| `(\w+)` \| [a-z, ]+ \| (.*?) \| (.*?) \|", PAGE.read_text(), re.M)
    assert [row[0] for row in rows] == list(HARD)
    for name, why, answer in rows:
        assert why == HARD[name].why
        assert (answer == "closed form") == (HARD[name].closed_form is not None)
    assert PAGE.with_suffix(".png").stat().st_size < 500_000


def test_the_measure_is_0_of_the_answer_and_1_without_shadows():
    answer = _answer("contact")
    assert answer.error(answer.image) == 0
    bare = answer.setup.scene.copy()
    for entry in answer.setup.scene.entries:
        bare.set_look(entry.name, casts=False)
    setup = answer.setup
    image = ss.render(bare, setup.camera, setup.lights, "hard")
    assert answer.error(image) == pytest.approx(1, abs=1e-6)


def test_a_table_has_a_row_for_each_method_also_for_those_that_refuse():
    names, methods = ["panes", "closed_housing"], ["wedges", "hard", ss.RayTraced(samples=4)]
    table = HARD.table(names, methods)
    assert table["scene"].tolist() == ["panes"] * 3 + ["closed_housing"] * 3
    refused = table[table["refused"] != ""]
    assert refused[["scene", "method"]].to_numpy().tolist() == [["panes", "wedges"]]
    assert "opacity" in refused["refused"].item()
    assert math.isnan(refused["shadow_error"].item())
    assert refused["excuse"].item() == "Opaque casters only."
    by_hard = table[(table["scene"] == "panes") & (table["method"] == "hard")]
    assert by_hard["tolerance"].item() == HARD["panes"].tolerance("hard")
    # Tolerances are of the collection's own settings and size.
    assert table[table["parameters"] == "samples=4"]["tolerance"].isna().all()
    larger = HARD.compare(["panes"], ["hard"], width=80, height=60)["panes"]
    assert larger.reference.visibility.shape == (2, 60, 80)
    assert larger.table["tolerance"].isna().all()


def test_progress_is_told_and_a_wrong_name_is_an_error():
    told = []
    HARD.compare(["contact", "fork"], ["hard"], told.append)
    assert told == [0.0, 0.5, 1.0]
    with pytest.raises(KeyError, match="no hard case 'knife'; there are half_plane, "):
        HARD["knife"]
    with pytest.raises(ValueError, match="unknown name 'soft'"):
        HARD.compare(["fork"], ["soft"])


def test_the_command_writes_a_page_with_what_is_hard_and_who_refuses(tmp_path, capsys):
    page = tmp_path / "hard.html"
    # Few methods take part, so that it is quick.
    assert cli.main(["hard", "-o", str(page), "--case", "eclipse"]) == 0
    assert capsys.readouterr().out == f"{page}: eclipse\n"
    text = page.read_text()
    assert f"<p>{HARD['eclipse'].why}</p>" in text
    assert "shadow error" in text
    assert "add them as meshes" in text[text.index('id="skipped"') :]
    assert cli.main(["hard", "-o", str(page), "--case", "knife"]) == 2
    assert "--case 'knife': expected one of half_plane, eclipse" in capsys.readouterr().err
