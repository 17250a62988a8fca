"""Draws the path of a pixel from the source to the film, for docs/colour.md.

python -m docs.make_colour_figure
"""

from __future__ import annotations

from xml.sax.saxutils import escape

from docs.pictures import DOCS

FILE = DOCS / "colour" / "path.svg"
WIDTH, ROW, TOP = 920, 46, 44
LEFT, MIDDLE, RIGHT = 14, 366, 648
BOX = {LEFT: 296, MIDDLE: 196, RIGHT: 258}
"""Width of the boxes of each column, px."""
SOURCES = (
    ("SDR video, stills", "matrix and range of the stream; ICC profile"),
    ("BT.2020, P3", "light of the display to BT.709"),
    ("PQ, HLG", "203 cd/m2 is white; or a view"),
    ("EXR", "chromaticities to Rec. 709; or a view"),
    ("any space that is named", "OpenColorIO; with or without a view"),
)
FILMS = (
    ("MP4, WebM, GIF, PNG", "8 bit, sRGB or BT.709"),
    ("ProRes, DNxHR, HEVC, AV1", "10 bit, BT.709"),
    ("PNG, TIFF 16", "sRGB, or any space"),
    ("EXR", "linear Rec. 709, or any space"),
)
PAINTING = (
    ("display-referred sRGB", "painted in 8 bit"),
    ("multistyle, steady, layers", "composited in 16 bit or float"),
)


def _box(x: int, y: float, title: str, text: str, strong: bool = False) -> str:
    fill = "#f3e3d8" if strong else "#f6f4ef"
    return (
        f'<rect x="{x}" y="{y}" width="{BOX[x]}" height="{ROW - 8}" rx="5" fill="{fill}" stroke="#6b655c"/>'
        f'<text x="{x + 9}" y="{y + 16}" font-weight="600">{escape(title)}</text>'
        f'<text x="{x + 9}" y="{y + 31}" fill="#5b554c">{escape(text)}</text>'
    )


def _arrow(x0: float, y0: float, x1: float, y1: float, dashed: bool = False) -> str:
    dash = ' stroke-dasharray="5 4"' if dashed else ""
    middle = (x0 + x1) / 2
    path = f"M{x0} {y0}C{middle} {y0} {middle} {y1} {x1 - 7} {y1}"
    return f'<path d="{path}" fill="none" stroke="#6b655c"{dash} marker-end="url(#tip)"/>'


def document() -> str:
    """The picture as SVG."""
    parts: list[str] = []
    centre = TOP + len(SOURCES) * ROW / 2 - 4
    painting = [centre - ROW / 2 - 23, centre + ROW / 2 - 15]
    for row, (title, text) in enumerate(SOURCES):
        y = float(TOP + row * ROW)
        parts += [_box(LEFT, y, title, text), _arrow(LEFT + BOX[LEFT], y + 19, MIDDLE, painting[0] + 19)]
    for y, (title, text) in zip(painting, PAINTING, strict=True):
        parts.append(_box(MIDDLE, y, title, text, strong=True))
    for row, (title, text) in enumerate(FILMS):
        y = TOP + (row + 0.5) * ROW
        parts += [_box(RIGHT, y, title, text), _arrow(MIDDLE + BOX[MIDDLE], painting[row > 0] + 19, RIGHT, y + 19)]
    bottom = TOP + len(SOURCES) * ROW + 18
    parts.append(_arrow(LEFT + BOX[LEFT] / 2, bottom + 8, RIGHT + BOX[RIGHT], bottom + 8, dashed=True))
    parts.append(f'<text x="{MIDDLE - 84}" y="{bottom + 26}" fill="#5b554c">opacity: beside the paint, or that of the '
                 "strokes (output.alpha)</text>")  # fmt: skip
    heads = zip((LEFT, MIDDLE, RIGHT), ("source", "paint", "film"), strict=True)
    parts += [f'<text x="{x}" y="26" font-size="15" font-weight="600">{head}</text>' for x, head in heads]
    tip = '<marker id="tip" viewBox="0 0 8 8" refX="1" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    tip += '<path d="M0 0L8 4L0 8z" fill="#6b655c"/></marker>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {bottom + 42}" font-family="sans-serif" '
        f'font-size="12" fill="#221f1b"><title>From the source to the film</title><defs>{tip}</defs>'
        f'<rect width="100%" height="100%" fill="#fff"/>{"".join(parts)}</svg>\n'
    )


if __name__ == "__main__":
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(document())
