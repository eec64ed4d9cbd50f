"""One builder for every page: a template of a room, with the style and macros that all share."""

from __future__ import annotations

from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape


def render(package: str, template: str, **values: Any) -> str:
    """Text of a page.

    A template may import ``macros.html``, and may put a file into the page as it is with
    ``source(name)``, say ``{{ source('page.css') | safe }}``.

    Parameters
    ----------
    package : str
        Dotted name of the package that holds the template, and what the template names.
    template : str
        Its path in the package; values are escaped in one that ends in ``.html`` or ``.html.j2``.
    **values
        What the template names; one that is missing is an error.
    """
    loader = ChoiceLoader([PackageLoader(each, '') for each in (package, __package__)])
    environment = Environment(
        loader=loader,
        autoescape=select_autoescape(['html', 'html.j2']),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    values['source'] = lambda name: loader.get_source(environment, name)[0]
    return environment.get_template(template).render(values)
