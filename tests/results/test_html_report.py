"""A report: its verdict follows the numbers, every effect is named, foreign text is only shown, nothing is fetched."""

import re
from html.parser import HTMLParser

import numpy as np
import pandas
import pytest
from typer.testing import CliRunner
from written_run import written_run, written_study

from emclutch.cli.main import app
from emclutch.effects import EffectsSection
from emclutch.results import OutputError, RunFolder, load_result
from emclutch.results.report.render import html, markdown, write_index, write_page
from emclutch.results.report.report import Mark
from emclutch.results.report.run_report import FILES, run_report, write_failed_index
from emclutch.results.report.study_report import study_report
from emclutch.results.study_result import load_study, report_on
from emclutch.results.text import format_estimate, format_torque
from emclutch.simulation.check import omitted_effects_of

HOSTILE = "<script>alert(1)</script> & \"><img src=x onerror='x'>"


class Page(HTMLParser):
    """Elements with their attributes, and all text."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text, self._open = [], "", []
        self.feed(text)
        assert not self._open, f"never closed: {self._open}"

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in ("meta", "img", "br"):
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_the_page_of_a_run(tmp_path):
    """The title does nothing; pictures are inside; each effect is on or off; the torque has its interval."""
    result = load_result(written_run(tmp_path / "hostile", HOSTILE).path)
    text = html(run_report(result, omitted_effects_of(result)))
    page = Page(text)
    assert HOSTILE in page.text and {tag for tag, _ in page.elements}.isdisjoint({"script", "iframe", "object", "link"})
    assert not [name for _, given in page.elements for name in given if name.startswith("on")]
    sources = [given["src"] for _, given in page.elements if "src" in given]
    assert sources and all(source.startswith("data:image/png;base64,") for source in sources)
    assert {given["href"] for _, given in page.elements if "href" in given} <= set(FILES)
    assert any(given.get("content", "").startswith("default-src 'none'") for _, given in page.elements)
    state = dict(re.findall(r"<tr><td[^>]*>([^<]*)</td><td[^>]*>(on|off)</td>", text))
    effects = {name.replace("_", " ") for name in EffectsSection.names()}
    assert effects <= set(state) and {name for name in effects if state[name] == "on"} == {"dipoles"}
    assert format_torque(result.torque) in page.text and "(95 %: " in format_torque(result.torque)
    for short in (write_index(result.report()).read_text(encoding="utf-8"), result._repr_html_()):
        assert format_torque(result.torque) in short and "<script" not in short


def test_the_page_in_markdown(tmp_path):
    folder = written_run(tmp_path / "a run", "<script> [a](http://b) | c")
    folder.torque_picture.write_bytes(b"")
    text = markdown(run_report(load_result(folder.path)), tmp_path)
    acts = [line for line in text.splitlines() if not line.startswith("    ")]  # what is indented is shown as it is
    assert "# &lt;script> [a]\\(http://b) \\| c" in acts and not [line for line in acts if "<script>" in line]
    assert "](a%20run/torque.png)" in text


def test_a_run_that_fails_has_a_page_that_says_why(tmp_path):
    folder = RunFolder.create(tmp_path / "run", '[scene]\ntitle = "a <b>brake</b>"\n')
    write_failed_index(folder, "raise contact.stiffness")
    failed, page = folder.read_failure(), folder.index.read_text()
    assert failed is not None and failed.reason == "raise contact.stiffness" in page and "a &lt;b&gt;brake" in page


@pytest.mark.parametrize(
    ("written", "changed", "marks"),
    [
        ({}, {}, {"Balances close": Mark.GOOD}),
        ({"mean": 0.0}, {}, {"orque on the disc": Mark.UNUSABLE}),
        ({"off": 0.3}, {}, {"balance of": Mark.UNUSABLE}),
        ({}, {"max_overlap": 0.05}, {"overlap": Mark.WARNING}),
        ({}, {"max_overlap": 0.05, "contact": {"compliant": False}}, {"overlap": None}),  # rigid grains
    ],
)
def test_the_verdict_follows_the_numbers(tmp_path, written, changed, marks):
    folder = written_run(tmp_path / "run", **written)
    if changed:
        folder.write_summary(folder.read_summary() | changed)
    folder.write_plan(folder.read_plan() | {"omitted_effects": {"eddy_currents": "0.6"}})
    found = load_result(folder.path).verdict
    assert [one.mark for one in found if "eddy currents" in one.text] == [Mark.WARNING]
    for word, mark in marks.items():
        assert {one.mark for one in found if word in one.text} == {mark} - {None}, word


def test_warnings_of_the_scene_are_in_the_verdict_of_its_run(tmp_path):
    """A run started from Python prints no warning of its scene, so its result has it."""
    folder = written_run(tmp_path)
    text = "particles.density = 7.87 kg/m^3 is outside the usual range; is the unit kg/m^3?"
    folder.write_summary(folder.read_summary() | {"scene": {"warnings": [text]}})
    assert (Mark.WARNING, text) in [(one.mark, one.text) for one in load_result(tmp_path).verdict]


@pytest.mark.parametrize(("bias", "half"), [(0.23, 0.08), (0.05, 0.02)])
def test_the_best_estimate_comes_first_with_its_total_error(tmp_path, bias, half):
    """T/(1 + bias) with both errors in quadrature, then the raw torque; what is corrected is no reservation."""
    folder = written_run(tmp_path)
    part = {"name": "grains_per_gap", "half_width": half}
    error = {"bias": bias, "half_width": half, "total_error": half, "largest_part": part, "unknown": {},
             "extrapolated": {}, "accuracy_study": {"note": "", "file": "a", "date": ""}, "next": None}  # fmt: skip
    size = {"note": "4 grains across the gap", "torque_excess": 0.28, "torque_excess_low": 0.24,
            "torque_excess_high": 0.32}  # fmt: skip
    summary = folder.read_summary()
    torque = summary["torque"] | {"replicas": 4}
    folder.write_summary(summary | {"discretisation_error": error, "grain_size": size, "torque": torque})
    result = load_result(tmp_path)
    best, *others = result.verdict
    assert best.text == f"Torque on the disc: {format_estimate(result.best)}." and best.mark is Mark.GOOD
    raw = next(one.text for one in others if one.text.startswith(f"Raw torque: {format_estimate(result.torque)}"))
    assert raw.endswith(f"numerical settings add {100.0 * bias:.2g} %, corrected above.")
    assert any(f"dominant: grains per gap, {100.0 * half:.2g} %" in one.text for one in others)
    assert not any("28 %" in one.text for one in result.verdict)  # the general law is silent
    assert format_estimate(result.best) in write_index(result.report()).read_text(encoding="utf-8")


def test_a_torque_belongs_to_a_current_that_stays(tmp_path):
    """The mean over a current that falls to nothing is not the torque at 0 A."""
    folder = written_run(tmp_path / "run")
    folder.write_summary(folder.read_summary() | {"current": 0.0})
    history = pandas.read_csv(folder.history)
    for start, said in ((0.0, True), (1.0, False)):
        history.assign(current=np.linspace(start, 0.0, len(history))).to_csv(folder.history, index=False)
        assert (", at 0 A" in write_index(load_result(folder.path).report()).read_text(encoding="utf-8")) == said


def test_energies_of_the_table_close(tmp_path):
    """Energy at the start is not recorded: work and losses of the first window are not in the sums."""
    folder = written_run(tmp_path / "run", off=0.0)
    history = pandas.read_csv(folder.history)
    kinetic = 5.0 + np.arange(len(history))
    work = np.where(np.arange(len(history)) == 0, 9.0, 2.0)
    history.assign(kinetic_energy=kinetic, work_walls=work).to_csv(folder.history, index=False)
    (section,) = (one for one in run_report(load_result(folder.path)).sections if one.heading == "Balances")
    joule = {label: float(text.removesuffix(" J")) for label, text in section.blocks[0].rows if text.endswith(" J")}
    change = joule["energy: change of kinetic energy"]
    assert joule["energy: work walls"] == joule["energy: dissipated"] + change and change == len(history) - 1


def test_a_study_shows_its_points_and_which_are_missing_failed_or_newer_than_its_table(tmp_path):
    folder = written_study(tmp_path, [1.0, 2.0], HOSTILE)
    study = load_study(folder)
    page = Page(html(study_report(study, omitted_effects_of)))
    assert set(study.results()) == {"current 1 A", "current 2 A"} and HOSTILE in page.text
    for text in (page.text, load_study(folder)._repr_html_(), CliRunner().invoke(app, ["report", str(folder)]).output):
        assert "2 of 3 points done" in text
    assert all(format_torque(result.torque) in page.text for result in study.results().values())
    written_run(folder / "later", mean=3.0).summary.replace(folder / "point-001" / "summary.json")
    RunFolder.create(folder / "point-002", "").write_failure("raise contact.stiffness")
    reported = Page(html(study_report(load_study(folder), omitted_effects_of))).text
    for text in ("older than", "raise contact.stiffness"):
        assert text in reported and text not in page.text


def test_nothing_is_overwritten(tmp_path):
    page = report_on(written_run(tmp_path / "run").path, omitted_effects_of)
    assert [write_page(page).name for _ in range(2)] == ["report.html", "report-1.html"]
    with pytest.raises(OutputError, match="exists"):
        write_page(page, tmp_path / "run" / "report.html")
    assert CliRunner().invoke(app, ["report", str(tmp_path), "--html"]).exit_code == 2
