"""The Python script that makes the part and its variants."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sed2cad.files import write_text

if TYPE_CHECKING:
    from sed2cad.model import CadModel


def write_script(model: CadModel, path: Path, document: Path) -> None:
    """Fill templates/part.py.jinja with the dimensions of `model` that are single numbers."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()), undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )
    dimensions = [
        (name, key, value)
        for name, primitive in model.primitives.items()
        for key, value in primitive.parameters().items()
        if isinstance(value, float) and key != "offset"
    ]
    text = environment.get_template("part.py.jinja").render(
        name=model.name, unit=model.unit, document=document.name, dimensions=dimensions
    )
    write_text(path, text)


def template_folder() -> Path:
    """templates/ inside the installed package, or at the top of a checkout."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "templates"
    return inside if inside.is_dir() else package.parent / "templates"
