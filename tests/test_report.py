"""The front, and the page about a table: what is on it, and that a browser shows and sorts it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import softshadow as ss
from browser import BROWSER, command, printed
from softshadow import cli
from softshadow.report import sections
from softshadow.report.tables import read_table
from softshadow.scenes import stanford_bunny_path


def table(**columns):
    """A table with a method for each row."""
    size = len(next(iter(columns.values())))
    return pd.DataFrame({"method": [f"m{i}" for i in range(size)], **columns})


def on_front(seconds, errors, **more):
    return ss.front(table(frame_seconds=seconds, penumbra_mae=errors, **more)).tolist()


def test_the_front_is_what_no_other_row_beats_in_both():
    assert on_front([1, 2, 3, 4], [0.4, 0.5, 0.1, 0.2]) == [True, False, True, False]


def test_the_front_is_that_of_all_pairs_on_random_rows():
    """Small integers, so that there are ties of all kinds."""
    random = np.random.default_rng(3)
    for _ in range(50):
        x, y = random.integers(0, 5, (2, 12))
        beaten = [
            any(
                (x[j] <= x[i]) & (y[j] <= y[i]) & ((x[j] < x[i]) | (y[j] < y[i])) for j in range(12)
            )
            for i in range(12)
        ]
        assert on_front(x, y) == [not b for b in beaten]


def test_rows_that_are_equal_in_both_are_on_the_front_together():
    assert on_front([1, 1, 1], [0.1, 0.1, 0.2]) == [True, True, False]


def test_of_rows_that_tie_in_one_the_better_in_the_other_is_on_the_front():
    assert on_front([1, 1, 2], [0.2, 0.1, 0.1]) == [False, True, False]


def test_rows_without_a_number_are_no_points_and_beat_nobody():
    nan, inf = np.nan, np.inf
    assert on_front([1, nan, 0.5, 2], [0.2, 0.0, nan, inf]) == [True, False, False, False]


def test_failures_are_no_points_and_beat_nobody():
    errors = ["out of memory", None, np.nan, ""]
    assert on_front([0.1, 1, 2, 3], [0.0, 0.2, 0.1, 0.3], error=errors) == [
        *(False, True, True, False)
    ]


@pytest.mark.parametrize("column", ["scene", "light", "camera", "machine", "threads"])
def test_rows_of_two_settings_do_not_beat_each_other(column):
    settings = {column: [1, 1, 2]}
    assert on_front([1, 2, 3], [0.1, 0.2, 0.3], **settings) == [True, False, True]


def test_a_bias_counts_by_its_size_and_of_ssim_more_is_better():
    rows = table(frame_seconds=[1, 2, 3], bias=[-0.5, 0.1, 0.3], ssim=[0.5, 0.9, 0.7])
    assert ss.front(rows, y="bias").tolist() == [True, True, False]
    assert ss.front(rows, y="ssim").tolist() == [True, True, False]


def test_total_seconds_are_those_of_preparing_and_a_frame():
    rows = table(frame_seconds=[1, 2], prepare_seconds=[9, 1], penumbra_mae=[0.1, 0.1])
    assert ss.front(rows).tolist() == [True, False]
    assert ss.front(rows, "total_seconds").tolist() == [False, True]


def test_a_table_without_rows_has_no_front_and_one_without_the_column_is_an_error():
    assert on_front([], []) == []
    with pytest.raises(ValueError, match="no column 'p99'; it has method, frame_seconds"):
        ss.front(table(frame_seconds=[1]), y="p99")


@pytest.fixture(scope="module")
def result():
    setup = ss.scenes.stacked_boards(48, 32)
    methods = ["ray_traced", "hard", ss.RayTraced(samples=4), "wedges"]
    return ss.compare(
        setup.scene,
        setup.camera,
        setup.light,
        methods,
        reference=ss.RayTraced(64, seed=9),
        repeats=1,
    )


@pytest.fixture(scope="module")
def page(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    return ss.report(result, path, title="Boards & <sticks>", commands=["softshadow compare a.ply"])


class _Elements(HTMLParser):
    """What a page has: its elements with their attributes, and the ones that were not closed."""

    def __init__(self, text):
        super().__init__()
        self.found, self.open = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))
        if tag not in ("meta", "link", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_well_formed_and_loads_nothing(page):
    elements = _Elements(page.read_text())
    assert elements.open == []
    for tag, attributes in elements.found:
        for name in ("src", "href"):
            if name in attributes:
                assert attributes[name].startswith(("data:", "#")), (tag, attributes[name][:80])
    assert not re.search(r"@import|url\(|fetch\(|XMLHttp", page.read_text())
    policy = [a["content"] for t, a in elements.found if "http-equiv" in a]
    assert policy
    assert policy[0].startswith("default-src 'none'")


def test_the_page_has_the_front_pictures_table_machine_and_commands(page, result):
    text = page.read_text()
    headings = re.findall(r"<h2>(.*?)</h2>", text)
    assert headings == [
        *("The front", "All cases", "Pictures and errors", "Machine", "How to reproduce")
    ]
    assert "<title>Boards &amp; &lt;sticks&gt;</title>" in text
    assert "softshadow compare a.ply" in text
    assert "RayTraced(samples=64, seed=9" in text
    assert text.count("data:image/svg+xml") == 2  # the front, the profile
    assert text.count("data:image/png") == 2  # the reference, the strip
    cases = text[text.index('id="cases"') :]
    assert cases.count("<tr class=front>") == int(ss.front(result.table).sum())
    assert f"{ss.thread_count()}</dd>" in text


def test_failures_are_listed_with_their_messages_and_are_no_cases(tmp_path):
    rows = table(
        scene=["a", "a", "b"],
        frame_seconds=[1.0, np.nan, 2.0],
        penumbra_mae=[0.1, np.nan, 0.2],
        error=[None, "MemoryError: <none> left", None],
        machine=["one", None, "two"],
        time=pd.to_datetime(["2026-01-02", None, "2026-01-03"]),
    )
    text = ss.report(rows, tmp_path / "a.html").read_text()
    assert "3 cases, 3 methods" in text
    assert "1 failed" in text
    failures = text[text.index('id="failures"') :]
    assert "MemoryError: &lt;none&gt; left" in failures
    cases = text[text.index('id="cases"') : text.index('id="failures"')]
    assert ">m1<" not in cases
    assert ">m0<" in cases
    assert "<dd>one; two</dd>" in text
    assert "2026-01-02" in text


def test_what_a_budget_left_out_is_listed(result, tmp_path):
    left = ss.Comparison(result.table, result.images, result.reference, {"pcf": "about 9 s"})
    text = ss.report(left, tmp_path / "a.html").read_text()
    assert "1 left out" in text
    assert "about 9 s" in text[text.index('id="skipped"') :]


def test_several_comparisons_are_scenes_of_one_page(result, tmp_path):
    text = ss.report({"first": result, "second": result}, tmp_path / "a.html").read_text()
    assert "8 cases" in text
    assert "2 settings" in text
    assert text.count("<h3>first</h3>") == text.count("<h3>second</h3>") == 1
    assert "reference of second" in text


def test_notes_are_said_over_pictures_and_many_scenes_are_folded_away(
    result, tmp_path, monkeypatch
):
    found = {"first": result, "second": result}
    notes = {"second": "Boards <over> boards."}
    text = ss.report(found, tmp_path / "a.html", notes=notes).read_text()
    second = text[text.index("<h3>second</h3>") :]
    assert second.startswith("<h3>second</h3>\n<p>Boards &lt;over&gt; boards.</p>\n<figure>")
    assert "<details>" not in text
    monkeypatch.setattr(sections, "_OPEN", 1)
    text = ss.report(found, tmp_path / "a.html", notes=notes).read_text()
    # Their figures of the front, and their pictures.
    assert text.count("<details><summary>second</summary>") == 2
    assert _Elements(text).open == []


def test_pictures_that_a_table_names_are_shown(result, tmp_path):
    rows = result.table.assign(image=None, scene="boards")
    for i, image in enumerate(result.images.values()):
        file = tmp_path / f"{i}.npz"
        np.savez(file, visibility=image.visibility, reference=result.reference.visibility)
        rows.loc[i, "image"] = str(file)
    assert "Pictures and errors" in ss.report(rows, tmp_path / "a.html").read_text()
    rows["image"] = "gone.npz"
    assert "Pictures and errors" not in ss.report(rows, tmp_path / "a.html").read_text()


def test_a_table_without_any_penumbra_is_a_page_that_says_so(tmp_path):
    rows = table(frame_seconds=[1.0, 2.0], penumbra_mae=[np.nan, np.nan])
    assert "no case has a time and an error" in ss.report(rows, tmp_path / "a.html").read_text()


@pytest.mark.parametrize(
    ("rows", "name", "error", "message"),
    [
        (table(frame_seconds=[1], penumbra_mae=[1]), "a.pdf", ValueError, "ends in .html"),
        (table(frame_seconds=[1], penumbra_mae=[1]), "no/a.html", OSError, "there is no folder"),
        (table(frame_seconds=[1]), "a.html", ValueError, "no column 'penumbra_mae'"),
        (table(frame_seconds=[], penumbra_mae=[]), "a.html", ValueError, "at least one row"),
        ({}, "a.html", ValueError, "at least one comparison"),
        ([1, 2], "a.html", TypeError, "pandas table or a Comparison, got list"),
    ],
)
def test_what_cannot_be_reported_is_an_error(rows, name, error, message, tmp_path):
    with pytest.raises(error, match=message):
        ss.report(rows, tmp_path / name)


def test_the_command_reads_tables_from_files(result, tmp_path, capsys):
    result.table.to_csv(tmp_path / "a.csv", index=False)
    out = tmp_path / "a.html"
    assert cli.main(["report", str(tmp_path / "a.csv"), "-o", str(out), "--title", "Mine"]) == 0
    assert capsys.readouterr().out == f"{out}: 4 cases\n"
    assert "<h1>Mine</h1>" in out.read_text()
    assert f"softshadow report {tmp_path / 'a.csv'} -o {out} --title Mine" in out.read_text()


def test_the_command_reads_a_folder_of_parquet_parts(result, tmp_path, capsys):
    pytest.importorskip("pyarrow")
    store = tmp_path / "results.parquet"
    store.mkdir()
    for i in range(len(result.table)):
        result.table.iloc[[i]].to_parquet(store / f"part-{i}.parquet")
    (store / "_softshadow.json").write_text("{}")
    assert read_table(store)["method"].tolist() == sorted(result.table["method"])
    assert cli.main(["report", str(store), "-o", str(tmp_path / "a.html")]) == 0
    assert capsys.readouterr().out.endswith("4 cases\n")


@pytest.mark.skipif(stanford_bunny_path() is None, reason="the bunny's package is not installed")
def test_the_demo_ends_with_a_page(tmp_path):
    demo = Path(__file__).parents[1] / "examples" / "demo.py"
    command = [sys.executable, str(demo), str(tmp_path), "--size", "32", "--budget", "20"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert f"the page: {tmp_path / 'report.html'}" in done.stdout
    text = (tmp_path / "report.html").read_text()
    assert "make demo" in text
    assert (tmp_path / "hard_visibility.png").is_file()
    assert "on the front" in (tmp_path / "table.txt").read_text()


@pytest.mark.parametrize(
    ("name", "message"),
    [("gone.parquet", "no such file or folder"), ("text.parquet", "cannot be read|pyarrow")],
)
def test_a_table_that_cannot_be_read_is_one_line(name, message, tmp_path, capsys):
    (tmp_path / "text.parquet").write_text("no table")
    assert cli.main(["report", str(tmp_path / name), "-o", str(tmp_path / "a.html")]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert error.count("\n") == 1


PRESS = """
<script>
const rows = () => [...document.querySelectorAll("#cases tbody tr")]
  .map(row => row.cells[1].textContent);
const press = text => [...document.querySelectorAll("#cases thead button")]
  .find(button => button.textContent === text).click();
const said = [rows()];
for (const text of ["frame s", "frame s", "method", "penumbra mae"]) {
  press(text);
  said.push(rows());
}
const images = [...document.images]
  .map(image => image.decode().then(() => image.naturalWidth > 100, () => false));
Promise.all(images).then(all => {
  document.title = "checked";
  document.body.setAttribute("data-said", JSON.stringify([said, all]));
});
</script>
"""


@pytest.mark.skipif(not BROWSER, reason="no browser is installed")
def test_a_browser_shows_the_pictures_and_sorts_the_table(page, result, tmp_path):
    (first, up, down, names, errors), loaded = _said(page, PRESS, tmp_path)
    by_time = result.table.sort_values("frame_seconds")["method"].tolist()
    assert first == result.table["method"].tolist()
    assert up == by_time
    assert down == by_time[::-1]
    assert names == sorted(first)
    assert errors == result.table.sort_values("penumbra_mae")["method"].tolist()
    assert loaded == [True] * 4


FILTER = """
<script>
const field = document.querySelector("input.filter");
const said = ["", "BOARD 7", "board 7 wedges", "nothing"].map(words => {
  field.value = words;
  field.dispatchEvent(new Event("input"));
  return [...document.querySelectorAll("#cases tbody tr")].filter(row => !row.hidden).length;
});
document.body.setAttribute("data-said", JSON.stringify(said));
</script>
"""


@pytest.mark.skipif(not BROWSER, reason="no browser is installed")
def test_a_browser_filters_a_long_table_by_words(tmp_path):
    names = [(scene, m) for scene in range(20) for m in ("hard", "wedges")]
    rows = table(frame_seconds=range(1, 41), penumbra_mae=range(1, 41), samples=4, parameters="")
    rows["scene"] = [f"board {scene}" for scene, _ in names]
    rows["method"] = [method for _, method in names]
    page = ss.report(rows, tmp_path / "long.html")
    assert page.read_text().count("data:image/png") == 20  # many settings: small figures
    # Words, and parts of them: of boards 7 and 17.
    assert _said(page, FILTER, tmp_path) == [40, 4, 2, 0]


def _said(page, script, folder):
    """What a script says in a browser, as ``data-said`` of the page's body."""
    copy = folder / "pressed.html"
    copy.write_text(page.read_text().replace("</body>", f"{script}</body>"))
    switches = ["virtual-time-budget=10000", "dump-dom"]
    done = printed([*command(folder / "profile", *switches), copy.as_uri()])
    found = re.search(r'data-said="([^"]*)"', done)
    assert found, done[-2000:]
    return json.loads(found[1].replace("&quot;", '"'))
