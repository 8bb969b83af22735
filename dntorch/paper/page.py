"""The page of a reproduction: each claim beside our number, and the figures."""

from pathlib import Path

from dntorch.paper.claims import claims
from dntorch.paper.study import Study
from dntorch.paper.verdict import NO, UNTESTABLE, YES


def write_page(study: Study, figures: list[str], folder: Path, command: str) -> Path:
    """``report.html`` beside the figures."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(loader=PackageLoader("dntorch", "paper"), autoescape=True)
    page = environment.get_template("page.html").render(
        claims=claims(study), results=study.results, figures=figures, command=command,
        colors={YES: "yes", NO: "no", UNTESTABLE: "open"},
    )  # fmt: skip
    path = folder / "report.html"
    path.write_text(page, encoding="utf-8")
    return path
