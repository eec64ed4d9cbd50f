"""The page of the method against the code."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / 'docs' / 'method.md'
CODE = PAGE.parents[1] / 'ftp_dent_ros' / 'profilometry'


def test_every_constant_of_the_page_is_in_the_module_that_it_names():
    sections = re.split(r'(?m)^(?=\*\*`[\w/]+\.py`\*\*)', PAGE.read_text())[1:]
    assert len(sections) > 40
    for section in sections:
        module = re.match(r'\*\*`([\w/]+\.py)', section)[1]
        code = (CODE / module).read_text()
        for name in re.findall(r'(?m)^\| `(\w+)`', section):
            assert re.search(rf'(?m)^(?:\w+, )*{name}\b.*=', code), (module, name)
