"""The widget in JupyterLab: a real kernel, a real browser, a real drag."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import time

import pytest
from browser import BROWSER, opened

pytest.importorskip("anywidget")
pytest.importorskip("jupyterlab")
nbformat = pytest.importorskip("nbformat")

CELL = """
import softshadow as ss
find = ss.scenes.stanford_bunny_path()
setup = (ss.scenes.bunny_on_plane if find else ss.scenes.stacked_boards)(320, 240)
moving = ss.widget(setup.scene, setup.camera, setup.light)
moving
"""

SHARED = "const [canvas, text] = ['canvas', '.softshadow-text'].map((s) => document.querySelector("
SHARED += "'.softshadow-widget ' + s));"


@pytest.fixture
def lab(tmp_path):
    """The address of a notebook in JupyterLab, which ends with the test."""
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(CELL)])
    notebook.metadata.kernelspec = {"name": "python3", "display_name": "", "language": "python"}
    nbformat.write(notebook, tmp_path / "moving.ipynb")
    own = {f"JUPYTER_{name}_DIR": str(tmp_path / name) for name in ("CONFIG", "DATA", "RUNTIME")}
    command = [
        *(sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", "--port=0"),
        *("--expose-app-in-browser", f"--ServerApp.root_dir={tmp_path}", "--ip=127.0.0.1"),
    ]
    with (
        (tmp_path / "lab.txt").open("w") as log,
        subprocess.Popen(
            command, stderr=log, stdout=log, env=os.environ | own, start_new_session=True
        ) as process,
    ):
        try:
            yield _address(tmp_path / "RUNTIME")
        finally:
            os.killpg(process.pid, signal.SIGKILL)


def _address(folder, seconds=60):
    """Wait for the file in which a server says where it listens."""
    for _ in range(10 * seconds):
        for file in folder.glob("jpserver-*.json"):
            said = json.loads(file.read_text())
            return f"{said['url']}doc/tree/moving.ipynb?token={said['token']}"
        time.sleep(0.1)
    raise TimeoutError(f"no server within {seconds} s")


@pytest.mark.slow
@pytest.mark.skipif(not BROWSER, reason="no browser is installed")
def test_a_drag_in_jupyter_moves_the_light_and_lags_by_one_picture_at_most(lab, tmp_path):
    async def visit():
        async with opened(lab, tmp_path / "profile") as page:
            await page.until("window.jupyterapp?.shell.currentWidget?.sessionContext")
            await page.run(
                "jupyterapp.shell.currentWidget.sessionContext.ready"
                ".then(() => jupyterapp.commands.execute('notebook:run-all-cells')).then(() => 1)"
            )
            await page.until("document.querySelector('.softshadow-widget canvas')?.width == 320")
            box = await page.run(
                "(({x, y}) => [x, y])"
                "(document.querySelector('.softshadow-widget canvas').getBoundingClientRect())"
            )
            await page.run(
                SHARED + "window.drawn = 0; window.said = () => text.textContent;"
                "window.pixels = () => canvas.toDataURL();"
                "new MutationObserver(() => drawn++).observe(text, {childList: true});"
            )
            start, before = await page.run("said()"), await page.run("pixels()")
            assert "wedges: " in start
            x, y = box[0] + 60, box[1] + 60
            await page.mouse("Moved", x, y)
            await page.mouse("Pressed", x, y)
            began, moves = time.perf_counter(), 0
            while time.perf_counter() - began < 4:
                moves += 1
                await page.mouse("Moved", x + moves % 150, y + moves % 100)
            seconds = time.perf_counter() - began
            during = await page.run("drawn")
            await page.mouse("Moved", x + 30, y)
            await page.mouse("Released", x + 30, y)
            print(f"{moves} moves, {during / seconds:.1f} pictures a second, {start}")
            await asyncio.sleep(1)
            last = await page.run("said()")
            assert last.partition("wide, at")[2] != start.partition("wide, at")[2]
            # Of many more moves than pictures, none is drawn late.
            assert moves > during > 4
            drawn = await page.run("drawn")
            assert drawn - during <= 3
            await page.picture(tmp_path / "moved.png")
            await page.run(
                "const method = document.querySelector('.softshadow-widget select');"
                "method.value = 'hard'; method.dispatchEvent(new Event('change'));"
            )
            await page.until("said().startsWith('hard: ')")
            assert len({before, await page.run("pixels()")}) == 2
            await page.picture(tmp_path / "hard.png")

    asyncio.run(visit())
