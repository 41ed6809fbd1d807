"""The least that is an OpenDocument spreadsheet, and a workbook whose sheet holds given rows."""

import io
import zipfile

import openpyxl

SHEET = '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>'


def packed(parts):
    """An archive of files by name."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as book:
        for name, data in parts.items():
            book.writestr(name, data)
    return file.getvalue()


def xlsx(rows):
    """A workbook whose sheet holds these rows, as XML."""
    book = io.BytesIO()
    openpyxl.Workbook().save(book)
    with zipfile.ZipFile(book) as file:
        parts = {name: file.read(name) for name in file.namelist()}
    return packed(parts | {"xl/worksheets/sheet1.xml": SHEET.format(rows)})


def cell(content, repeated=""):
    """A cell of a spreadsheet, of a number or a text."""
    if isinstance(content, float):
        return f'<table:table-cell office:value-type="float" office:value="{content}"/>'
    return (
        "<table:table-cell "
        f'office:value-type="string"{repeated}><text:p>{content}</text:p></table:table-cell>'
    )


def row(cells, repeated=""):
    """A row of cells."""
    return f"<table:table-row{repeated}>{cells}</table:table-row>"


def ods(rows):
    """A spreadsheet of these rows."""
    parts = ("office", "table", "text")
    spaces = " ".join(
        f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"' for name in parts
    )
    return packed(
        {
            "mimetype": "application/vnd.oasis.opendocument.spreadsheet",
            "META-INF/manifest.xml": "<manifest/>",
            "content.xml": f"<office:document-content {spaces}><office:body><office:spreadsheet>"
            f'<table:table table:name="t">{rows}</table:table>'
            "</office:spreadsheet></office:body></office:document-content>",
        }
    )
