"""The documents lead to files and headings that are there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')]


def anchors(page):
    """Names of a page's headings, as a link has them."""
    headings = re.findall(r'(?m)^#+ (.+)$', page.read_text())
    return [re.sub(r'[^\w\- ]', '', each.lower()).replace(' ', '-') for each in headings]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for link in re.findall(r'\]\(([^)\s]+)\)', page.read_text()):
        if link.startswith(('http://', 'https://')):
            continue
        name, _, anchor = link.partition('#')
        target = page.parent / name if name else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_benchmarks_are_there_and_have_the_options_that_are_named(page):
    for name, rest in re.findall(r'`(?:benchmarks/)?(\w+\.py) (-[^`]*)`', page.read_text()):
        program = (ROOT / 'benchmarks' / name).read_text()
        for option in re.findall(r'(?<!\S)--[a-z-]+', rest):
            assert f"'{option}'" in program, (name, option)


def test_programs_that_are_named_are_there():
    for page in PAGES:
        for path in re.findall(r'`((?:benchmarks|tools|config)/[\w/]+\.\w+)\b', page.read_text()):
            assert (ROOT / path).is_file(), (page, path)
