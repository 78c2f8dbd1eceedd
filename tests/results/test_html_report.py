"""A report in one page: the verdict first, every effect named, untrusted text only shown, nothing from elsewhere."""

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
from emclutch.results.report.content import FILES, page_of, run_page, study_page
from emclutch.results.report.render import html, markdown, write_index, write_page
from emclutch.results.report.verdict import Mark, verdict
from emclutch.results.study_folder import read_study
from emclutch.results.study_result import load_study
from emclutch.results.text import format_torque
from emclutch.simulation.check import left_out_of

HOSTILE = "<script>alert(1)</script> & \"><img src=x onerror='x'>"


class Page(HTMLParser):
    """Elements with their attributes, headings in order, the table of effects, and all text."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text, self.headings, self.effects, self._cells, self._open = [], "", [], {}, None, []
        self.feed(text)
        assert not self._open, f"never closed: {self._open}"

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in ("meta", "img", "br"):
            self._open.append(tag)
        if tag == "tr":
            self._cells = []
        if tag in ("td", "th") and self._cells is not None:
            self._cells.append("")
        if tag == "h2":
            self.headings.append("")

    def handle_endtag(self, tag):
        assert self._open.pop() == tag
        if tag == "tr" and len(self._cells) == 6:
            self.effects[self._cells[0]] = self._cells[1]

    def handle_data(self, data):
        if self._open and self._open[-1] == "style":
            return
        self.text += data
        if self._open and self._open[-1] == "h2":
            self.headings[-1] += data
        if self._cells:
            self._cells[-1] += data.strip()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return written_run(tmp_path_factory.mktemp("runs") / "hostile", HOSTILE)


@pytest.fixture(scope="module")
def page(run):
    return Page(html(run_page(load_result(run.path), left_out_of)))


def test_the_verdict_comes_first(page):
    assert page.headings[:3] == ["Conclusion", "Operating point", "Verdict"]
    wanted = ["Scene", "Effects, on and off", "Pictures", "Torque with its errors", "Balances", "Provenance"]
    assert [heading for heading in page.headings if heading in wanted] == wanted


def test_untrusted_text_is_shown_and_does_nothing(page):
    """The title stands in the page as it was given, and adds no element."""
    assert HOSTILE in page.text
    assert {tag for tag, _ in page.elements}.isdisjoint({"script", "iframe", "object", "link"})
    assert not [name for _, given in page.elements for name in given if name.startswith("on")]


def test_untrusted_text_is_no_markup_of_markdown(tmp_path):
    title = "<script> [a](http://b) | c"
    text = markdown(run_page(load_result(written_run(tmp_path / "run", title).path), left_out_of), tmp_path)
    acts = [line for line in text.splitlines() if not line.startswith("    ")]  # what is indented is shown as it is
    assert "# &lt;script> [a]\\(http://b) \\| c" in acts and not [line for line in acts if "<script>" in line]


def test_markdown_has_the_sections_of_the_page_and_links_to_pictures(tmp_path):
    folder = written_run(tmp_path / "a run")
    folder.torque_picture.write_bytes(b"")
    text = markdown(run_page(load_result(folder.path), left_out_of), tmp_path)
    assert "](a%20run/torque.png)" in text
    assert {"## Verdict", "## Balances", "## Provenance"} <= set(text.splitlines())


def test_nothing_is_fetched(page):
    """Pictures are inside; links lead to files beside the page only."""
    sources = [given["src"] for _, given in page.elements if "src" in given]
    assert sources and all(source.startswith("data:image/png;base64,") for source in sources)
    assert {given["href"] for _, given in page.elements if "href" in given} <= set(FILES)
    assert any(given.get("content", "").startswith("default-src 'none'") for _, given in page.elements)


def test_every_effect_is_named_on_or_off(page):
    named = {name.replace("_", " ") for name in EffectsSection.names()}
    assert named <= set(page.effects)
    assert {name for name in named if page.effects[name] == "on"} == {"dipoles"}


def test_the_effects_alone_are_stacked_on_a_narrow_screen(run):
    """The class is that of the one table whose columns the page names there, however many a table has."""
    text = html(run_page(load_result(run.path), left_out_of))
    (stacked,) = re.findall(r'<table class="stack">\s*<tr>(.*?)</tr>', text, re.DOTALL)
    head = re.findall("<th>(.*?)</th>", stacked)
    for number, name in enumerate(head[3:5], start=4):
        assert re.search(rf"\.stack td:nth-child\({number}\)::before {{ content: .*{name}: ", text)


def test_the_torque_stands_with_its_interval(run, page):
    torque = load_result(run.path).torque
    assert format_torque(torque) in page.text and "(95 %: " in format_torque(torque)


def test_a_run_has_a_short_page_in_its_folder(tmp_path):
    """index.html holds the conclusion and the operating point; summary and notebook say the same."""
    folder = written_run(tmp_path / "run", HOSTILE)
    folder.write_summary(folder.read_summary() | {"current": 1.5, "voltage": 24.0, "copper_loss": 36.0, "slip": 10.0})
    result = load_result(folder.path)
    page, shown = write_index(result).read_text(encoding="utf-8"), result._repr_html_()
    for text in ("at 1.5 A and 95.49 rpm of slip is", "36 W", "history.csv"):
        assert text in page and text in shown
    assert "<script" not in page + shown and "columns of" in html(run_page(result, left_out_of))
    said = [(one.mark.value, one.text) for one in result.verdict]
    assert [(one["mark"], one["text"]) for one in result.summary["verdict"]] == said
    study = load_study(written_study(tmp_path / "study", [1.0, 2.0]))
    assert "2 of 3 points are done" in study._repr_html_()


def test_a_torque_is_not_said_to_be_that_of_the_last_current_where_it_changes(tmp_path):
    """The mean over a current that falls to nothing is not the torque at 0 A; copper loss is that of the run's end."""
    folder = written_run(tmp_path / "run")
    history = pandas.read_csv(folder.history)
    history["current"] = np.linspace(1.0, 0.0, len(history))
    history.to_csv(folder.history, index=False)
    folder.write_summary(folder.read_summary() | {"current": 0.0, "copper_loss": 0.0, "expected_torque": {"law": "L"}})
    page = write_index(load_result(folder.path)).read_text(encoding="utf-8")
    assert " at 0 A" not in page and "copper loss, at the run&#x27;s end" in page.replace("&#39;", "&#x27;")
    assert "expected before the run" not in page


def test_an_effect_left_out_that_may_matter_is_in_the_conclusion_wherever_it_is_read(tmp_path):
    folder = written_run(tmp_path / "run")
    folder.write_plan(folder.read_plan() | {"may_matter": {"eddy_currents": "time over that of switching: 0.6"}})
    result = load_result(folder.path)
    page, text = write_index(result).read_text(encoding="utf-8"), "(time over that of switching: 0.6): eddy currents."
    assert "The verdict has 2 reservations" in page  # that, and one packing
    for said in (page.split("<h2>Verdict")[1], str(result.summary["verdict"]), str(result.verdict)):
        assert said.count(text) == 1


@pytest.mark.parametrize(("off", "mark"), [(1e-4, Mark.GOOD), (0.3, Mark.POOR)])
def test_a_balance_that_does_not_close_is_reported(tmp_path, off, mark):
    statements = verdict(load_result(written_run(tmp_path / "run", off=off).path))
    marks = [one.mark for one in statements if one.text.startswith("The balance of")]
    assert marks == [mark, mark]


def test_a_torque_is_known_only_as_far_as_its_error_says(tmp_path):
    """A few windows give no error, noise about 0 no torque: neither is called known."""
    first = verdict(load_result(written_run(tmp_path / "steady").path))[0]
    assert first.mark is Mark.GOOD and "is known to" in first.text
    short = verdict(load_result(written_run(tmp_path / "short", windows=10).path))[0]
    assert short.mark is Mark.POOR and "not known" in short.text
    none = verdict(load_result(written_run(tmp_path / "none", mean=0.0).path))[0]
    assert none.mark is Mark.POOR


def test_a_run_that_is_not_finished_says_so(tmp_path):
    folder = written_run(tmp_path / "cut", finished=False)
    text = Page(html(run_page(load_result(folder.path), left_out_of))).text
    assert "The run is not finished: it has come to 200 ms" in text


def test_a_study_shows_its_points_and_what_is_missing(tmp_path):
    study = read_study(written_study(tmp_path, [1.0, 2.0], HOSTILE))
    page = Page(html(study_page(study, left_out_of)))
    assert page.headings[0] == "Verdict" and HOSTILE in page.text and "2 of 3 points are done" in page.text
    for result in study.results().values():
        assert format_torque(result.torque) in page.text
    assert set(study.results()) == {"current 1 A", "current 2 A"}
    text = CliRunner().invoke(app, ["report", str(study.path)])
    assert text.exit_code == 0 and "2 of 3 points are done" in text.output


def test_a_study_says_which_points_are_newer_than_its_table_and_which_have_failed(tmp_path):
    folder = written_study(tmp_path, [1.0, 2.0])
    fresh = Page(html(study_page(read_study(folder), left_out_of))).text
    assert "older than" not in fresh and "failed" not in fresh
    written_run(folder / "later", mean=3.0).summary.replace(folder / "point-001" / "summary.json")
    RunFolder.create(folder / "point-002", "").write_failure("grains overlap; raise contact.stiffness")
    reported = Page(html(study_page(read_study(folder), left_out_of))).text
    assert "older than point-001; renew them with: emclutch sweep" in reported
    assert "point-002: the run failed before its first window: grains overlap; raise contact.stiffness" in reported


def test_nothing_is_overwritten(tmp_path):
    folder = written_run(tmp_path / "run").path
    page = page_of(folder, left_out_of)
    assert [write_page(page).name for _ in range(2)] == ["report.html", "report-1.html"]
    with pytest.raises(OutputError, match="exists"):
        write_page(page, folder / "report.html")
    reported = CliRunner().invoke(app, ["report", str(tmp_path), "--html"])
    assert reported.exit_code == 2 and re.search("name the folder of a run", reported.output)
