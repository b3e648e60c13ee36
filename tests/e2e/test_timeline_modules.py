"""The pure modules of the timeline and of what is taken along, run by the browser."""

import base64
import io
from itertools import pairwise
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Page

from tests.e2e.test_modules import module, run

__all__ = ["module"]
SPAN = {"first": 0, "last": 8000, "stop": 10_000}


def windowed(page: Page, call: str) -> Any:
    return run(page, "core/window.js", f"(span) => m.{call}", SPAN)


def test_a_stretch_is_zoomed_moved_and_drawn_within_what_there_is(module: Page) -> None:
    assert windowed(module, "zoomed([2000, 6000], 0.5, 3000, span, 10)") == [2500, 4500]
    assert windowed(module, "zoomed([2000, 6000], 1e-9, 3000, span, 10)") == pytest.approx([2990, 3030])
    assert windowed(module, "zoomed([2000, 6000], 1e9, 3000, span, 10)") == [0, 10_000]
    assert windowed(module, "panned([2000, 6000], 0.5, span)") == [4000, 8000]
    assert windowed(module, "panned([2000, 6000], 5, span)") == [6000, 10_000]
    for grip, to, expected in (
        ("all", 1500, [2500, 6500]),
        ("all", -9000, [0, 4000]),
        ("begin", 5990, [5960, 6000]),
        ("end", 99_000, [2000, 10_000]),
        ("new", 400, [400, 1000]),
        ("new", 1001, [1000, 1040]),
    ):
        assert windowed(module, f"dragged([2000, 6000], '{grip}', 1000, {to}, span, 10)") == expected, (grip, to)
    said = run(
        module, "core/window.js", "(xs) => xs.map((x) => m.gripAt(x, 100, 200, 6))", [93, 95, 104, 150, 197, 260]
    )
    assert said == ["new", "begin", "begin", "all", "end", "new"]


def test_playing_goes_round_in_its_loop_and_speeds_are_in_samples_too(module: Page) -> None:
    def moments(times: list[float], loop: list[float] | None) -> Any:
        script = "(times, loop, span) => times.map((time) => m.next(time, 60, loop, span))"
        return run(module, "core/playing.js", script, times, loop, SPAN)

    assert moments([100, 1990, 3000, 500], [1000, 2000]) == [1000, 1050, 1000, 1000]
    assert moments([1000, 1500], [1000, 2000]) == [1060, 1560]
    assert moments([9939, 9941], None) == [9999, 1]
    loops = "(pairs, span) => pairs.map(([one, other]) => m.loopOf(one, other, span, 60))"
    said = run(module, "core/playing.js", loops, [[3000, 1000], [-5, 4], [20_000, 9999]], SPAN)
    assert said == [[1000, 3000], [0, 60], [9940, 10_000]]
    speeds = run(
        module, "core/playing.js", "(interval) => ['5 samples', '600'].map((t) => m.speedOf(t, interval))", 300
    )
    assert speeds == [1500, 600]
    script = "(text, by) => m.otherSpeed(text, by, 300)"
    assert run(module, "core/playing.js", script, "600", 1) == "5 samples"  # of 300 s each: 1,500 s in one
    assert run(module, "core/playing.js", script, "1 sample", -1) == "1 sample"
    assert run(module, "core/playing.js", script, "86400", 1) == "86400"


def test_bars_show_a_single_reading_beside_many(module: Page) -> None:
    density = {"time": [0, 60, 120], "step_s": 60, "measurements": [1, 0, 100], "samples": [1, 0, 1]}
    bars = run(module, "core/density.js", "(density) => m.barsOf(density)", density)
    assert [(bar["start"], bar["share"]) for bar in bars] == [(0, 0.1), (120, 1)]
    at = run(module, "core/density.js", "(density) => [-1, 59, 179, 180].map((t) => m.countAt(density, t))", density)
    assert [each and each["measurements"] for each in at] == [None, 1, 100, None]


def test_what_is_taken_along_has_round_metres_whole_samples_and_plain_names(module: Page) -> None:
    bars = run(module, "core/taking.js", "(all) => all.map((p) => m.scaleBar(p, 140))", [100, 30, 9, 0.013])
    assert [bar["metres"] for bar in bars] == [1, 2, 10, 10_000]
    assert bars[1]["pixels"] == 60
    script = "(loop, span) => m.momentsOf(loop, 60, span, 10)"
    assert run(module, "core/taking.js", script, [0, 300], SPAN) == [0, 60, 120, 180, 240]
    many = run(module, "core/taking.js", script, [0, 10_000], SPAN)
    assert len(many) <= 10
    assert {later - time for time, later in pairwise(many)} == {1020}
    assert run(module, "core/taking.js", script, [0, 1e9], {**SPAN, "stop": 60}) == [0]
    name = run(module, "core/taking.js", "(...how) => m.fileName(...how)", ["lab/2", "7"], 1.7e9, "Asia/Kolkata", "png")
    assert name == "lab-2-7-2023-11-15-03-43.png"


def test_an_animated_picture_has_every_frame_for_as_long_as_it_should(module: Page) -> None:
    script = """async (colours) => {
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [65, 40];
      const ctx = canvas.getContext("2d", { alpha: false });
      const files = [];
      for (const colour of colours) {
        ctx.fillStyle = colour;
        ctx.fillRect(0, 0, 65, 40);
        const blob = await new Promise((resolve) => canvas.toBlob(resolve, "image/webp", 0.9));
        files.push(new Uint8Array(await blob.arrayBuffer()));
      }
      const made = m.animatedWebp(files, { width: 65, height: 40, duration_ms: 120, last_ms: 900 });
      return btoa(String.fromCharCode(...new Uint8Array(await made.arrayBuffer())));
    }"""
    content = base64.b64decode(run(module, "core/webp.js", script, ["#d00000", "#00b000", "#0000d0"]))
    image: Any = Image.open(io.BytesIO(content))
    assert (image.format, image.n_frames, image.size, image.info["loop"]) == ("WEBP", 3, (65, 40), 0)
    shown = []
    for frame in range(3):
        image.seek(frame)
        image.load()
        shown.append((image.info["duration"], max(range(3), key=image.convert("RGB").getpixel((30, 20)).__getitem__)))
    assert shown == [(120, 0), (120, 1), (900, 2)]
    refused = run(
        module,
        "core/webp.js",
        "() => { try { m.animatedWebp([new Uint8Array(20)], {}); } catch (e) { return e.message; } }",
    )
    assert refused == "this is no WebP"
