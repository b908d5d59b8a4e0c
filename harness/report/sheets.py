"""Tables of a report as sheets, whose units stand beside the names of rows, and back."""

from gough_stewart.harness.output.tables import Named, Sheet
from gough_stewart.harness.report.document import Column, Table, Value


def sheet_of(table: Table) -> Sheet:
    """The table as text; a row whose values are of one unit has it once, beside its name."""
    heads = tuple(column.quantity.headed(column.name) if column.quantity else column.name for column in table.columns)
    sheet = Sheet(table.title, heads)
    for k, row in enumerate(table.rows):
        texts = table.texts(k)
        units = {cell.quantity.unit for cell in row if isinstance(cell, Value)}
        cells: list[str | Named] = list(texts)
        is_of_rows = not any(column.quantity for column in table.columns)
        if is_of_rows and len(units) == 1 and (unit := units.pop()):
            cells = [
                cell.quantity.text(cell.value, unit=False) if isinstance(cell, Value) else text
                for cell, text in zip(row, texts, strict=True)
            ]
            cells[0] = Named(texts[0], unit)
        sheet.add(*cells, ends_group=k in table.group_ends)
    return sheet


def table_of(sheet: Sheet) -> Table:
    """The sheet as a table of texts."""

    def cell(each: str | Named) -> str:
        return each if isinstance(each, str) else f"{each.what} [{each.unit}]" if each.unit else each.what

    rows = tuple(tuple(map(cell, row)) for row in sheet.rows)
    return Table(sheet.title, tuple(map(Column, sheet.heads)), rows, group_ends=tuple(sheet.group_ends))
