"""Tables of a page: where cells stand, and how numbers are written."""

from typing import Any
from urllib.parse import unquote, urljoin, urlsplit

from lxml import html

from gough_stewart.harness.report.document import Report, Section, Verdict
from gough_stewart.harness.report.page import page_of
from gough_stewart.harness.report.quantities import Quantity
from gough_stewart.harness.report.table import Column, Table


def table_of(table: Table) -> Any:
    """The element of a page's only table."""
    page = page_of(Report("r", Verdict("v", "told"), (Section("s", (table,)),)))
    elements: Any = html.document_fromstring(page).xpath("//main//table")
    (element,) = elements
    return element


def test_links_lead_to_files_whatever_their_names_and_not_out_of_the_folder() -> None:
    """Expected: a browser's address, decoded, is the name; a path out of the folder is a text."""
    names = ("a#b.html", "50 %/c?d.html", 'e"f.html', "javascript:alert(1)", "../g.html", "/etc/h", "i/../../j")
    rows = tuple((name, 1.0) for name in names)
    table = table_of(Table("", (Column("name"), Column("n")), rows, links=names))
    assert [cell.text_content() for cell in table.xpath(".//tbody//th")] == list(names)
    addresses = [urlsplit(urljoin("file:///runs/report.html", link)) for link in table.xpath(".//a/@href")]
    assert [unquote(each.path) for each in addresses] == [f"/runs/{name}" for name in names[:4]]
    assert not any(each.query or each.fragment or each.scheme != "file" for each in addresses)


def test_numbers_are_at_the_right_with_a_minus_and_words_are_not() -> None:
    """Expected: by hand; the first column names its row, and a hyphen within words stays one."""
    columns = (Column("what"), Column("error", Quantity("m", "m")), Column("cause"), Column("share"))
    rows = (("leg-1", -0.25, "a-b", "-3 %"), ("leg-2", None, "stopped", "+4 %"))
    table = table_of(Table("errors", columns, rows))
    heads = [head.get("class") for head in table.xpath(".//thead//th")]
    assert heads == [None, "n", None, "n"]
    cells = [[cell.get("class") for cell in row.xpath("./td")] for row in table.xpath(".//tbody/tr")]
    assert cells == [["n", None, "n"]] * 2
    first = [cell.text_content() for cell in table.xpath(".//tbody/tr")[0]]
    assert first[0] == "leg-1"
    assert first[1].startswith("\N{MINUS SIGN}")
    assert first[2:] == ["a-b", "\N{MINUS SIGN}3 %"]
