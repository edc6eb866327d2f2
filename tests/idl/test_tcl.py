"""The back end that gives Combat, an ORB for Tcl, its interface repository."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

IDL = Path(__file__).resolve().parents[2] / "idl"
BASE = """
module Demo {
  typedef sequence<string> Names;
  enum Kind { ROUND, SQUARE };
  const string TITLE = "a {b";
  struct Part { string name; double widths[2][3]; };
  interface Later;
};
"""
SHOP = """
#include "base.idl"
module Demo {
  exception Refused { string<5> reason; };
  union Shape switch (Kind) { case ROUND: double radius; default: Part side; };
  interface Later { readonly attribute Object title; };
  interface Shop : Later {
    Part get(in Names which, out unsigned long long left) raises (Refused);
    oneway void note(in any value);
  };
};
"""
PRINTED = """\
# base.idl
package require combat
combat::ir add {
{module {IDL:Demo:1.0 Demo 1.0} {
{typedef {IDL:Demo/Names:1.0 Names 1.0} {sequence string}}
{enum {IDL:Demo/Kind:1.0 Kind 1.0} {ROUND SQUARE}}
{const {IDL:Demo/TITLE:1.0 TITLE 1.0} string a\\ \\{b}
{struct {IDL:Demo/Part:1.0 Part 1.0} {{name string} {widths {array {array double 3} 2}}} {}}
{interface {IDL:Demo/Later:1.0 Later 1.0}}
}}
}
# shop.idl
package require combat
combat::ir add {
{module {IDL:Demo:1.0 Demo 1.0} {
{exception {IDL:Demo/Refused:1.0 Refused 1.0} {{reason {string 5}}} {}}
{union {IDL:Demo/Shape:1.0 Shape 1.0} IDL:Demo/Kind:1.0 \
{{ROUND radius double} {(default) side IDL:Demo/Part:1.0}} {}}
{interface {IDL:Demo/Later:1.0 Later 1.0} {} {{attribute {IDL:Demo/Later/title:1.0 title 1.0} Object readonly}}}
{interface {IDL:Demo/Shop:1.0 Shop 1.0} {IDL:Demo/Later:1.0} {\
{operation {IDL:Demo/Shop/get:1.0 get 1.0} IDL:Demo/Part:1.0 \
{{in which IDL:Demo/Names:1.0} {out left {unsigned long long}}} {IDL:Demo/Refused:1.0}} \
{operation {IDL:Demo/Shop/note:1.0 note 1.0} void {{in value any}} {} oneway}}}
}}
}
"""


def printed(monkeypatch: pytest.MonkeyPatch, *files: str) -> str:
    monkeypatch.syspath_prepend(IDL)
    text: str = importlib.import_module("make_stubs").omniidl("-p", str(IDL), "-b", "tcl", *files)
    return text


def test_each_declaration_is_printed_also_of_an_included_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "base.idl").write_text(BASE)
    (tmp_path / "shop.idl").write_text(SHOP)
    monkeypatch.chdir(tmp_path)
    assert printed(monkeypatch, "base.idl", "shop.idl") == PRINTED
    assert "IDL:Demo/Names:1.0 Names" in printed(monkeypatch, "shop.idl")
