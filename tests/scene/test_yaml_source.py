"""Scalars, marks and refusals of the scene's YAML reader."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinrender.errors import InputError
from skinrender.scene.yaml_source import MAX_BYTES, parse_source, read_source


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e6", 1e6),
        ("5e-3", 5e-3),
        ("-.5", -0.5),
        ("3.", 3.0),
        ("1E+2", 100.0),
        ("007", 7),
        ("0o17", 15),
        ("0x1F", 31),
        ("-12", -12),
        (".inf", math.inf),
        ("-.inf", -math.inf),
        ("1e999", math.inf),
        ("true", True),
        ("False", False),
        ("null", None),
        ("~", None),
        ("", None),
        ("'1'", "1"),
        ("yes", "yes"),
        ("no", "no"),
        ("on", "on"),
        ("1:30", "1:30"),
        ("190:20:30", "190:20:30"),
        ("1_000", "1_000"),
        ("2026-11-22", "2026-11-22"),
        ("5 mm", "5 mm"),
        ("<<", "<<"),
        ("!!str 5", "5"),
    ],
)
def test_scalars_follow_yaml_1_2(text, value):
    data = parse_source(f"key: {text}\n", "scene.yaml").data
    assert data == {"key": value}
    assert type(data["key"]) is type(value)


def test_nan_and_a_number_of_thousands_of_digits_become_floats():
    assert math.isnan(parse_source(".nan", "s").data)
    assert parse_source("9" * 5000, "s").data == math.inf


@given(st.floats(allow_nan=False))
def test_every_python_float_is_read_back(value):
    assert float(parse_source(repr(value).replace("inf", ".inf"), "s").data) == value


@given(st.text(max_size=60))
def test_any_text_is_data_or_an_input_error(text):
    try:
        parse_source(text, "s")
    except InputError as error:
        assert str(error).startswith("s:")


def test_marks_point_at_keys_and_list_entries():
    source = parse_source("a:\n  b: 1\n  c: [2, {d: 3}]\n", "s")
    places = {".".join(path): str(mark) for path, mark in source.marks.items()}
    expected = {"": "s:1:1", "a": "s:1:1", "a.b": "s:2:3", "a.c": "s:3:3"}
    expected |= {"a.c.0": "s:3:7", "a.c.1": "s:3:10", "a.c.1.d": "s:3:11"}
    assert places == expected


def test_a_repeated_key_is_a_problem_that_names_both_places():
    problems = parse_source("a: 1\nb: 2\na: 3\n", "s").problems
    assert [str(p) for p in problems] == [
        "s:3:1: a: this key stands here a second time (first at s:1:1); keep one of them"
    ]


@pytest.mark.parametrize("text", ["!!python/object/apply:os.system [ls]", "!mine x", "!!binary aaaa", "!!set {a, b}"])
def test_tags_are_refused(text):
    problems = parse_source(f"a: {text}", "s").problems
    assert len(problems) == 1
    assert "remove the tag" in str(problems[0])
    assert str(problems[0]).startswith("s:1:4: a: the tag !")


def test_a_tag_that_does_not_fit_is_a_problem():
    assert "'abc' does not fit its tag !!int" in str(parse_source("a: !!int abc", "s").problems[0])


@pytest.mark.parametrize("text", [r'a: "\ud800"', r'a: {b: "\udfff x"}', r'["\ud83d\ude00"]'])
def test_half_a_character_is_a_problem(text):
    (problem, *_) = parse_source(text, "s").problems
    assert str(problem).startswith("s:1:") and "half of a surrogate pair" in str(problem)


def test_a_key_must_be_a_plain_word():
    assert "plain word" in str(parse_source("? [1, 2]\n: 3\n", "s").problems[0])


def test_aliases_are_copied():
    data = parse_source("a: &x {k: 1}\nb: *x\n", "s").data
    data["a"]["k"] = 2
    assert data["b"] == {"k": 1}


def test_an_alias_bomb_is_refused():
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    with pytest.raises(InputError, match="aliases expand"):
        parse_source("\n".join(lines), "s")


def test_an_alias_of_itself_is_refused():
    with pytest.raises(InputError, match="aliases expand"):
        parse_source("a: &a [*a]", "s")


@pytest.mark.parametrize("text", ["[" * 100_000, "{a: " * 5_000, "- " * 5_000])
def test_deep_nesting_is_refused(text):
    with pytest.raises(InputError, match="nested deeper than 20 levels"):
        parse_source(text, "s")


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("a: 1\n\tb: 2\n", "s:2:1", "spaces, not tabs"),
        ("a: [1, 2\nb: 3\n", "s:2:2", "brackets"),
        ("a: 1\n  b: 2\n", "s:2:4", "indentation"),
        ("a: *x\n", "s:1:4", "define the anchor"),
        ("a: 1\n---\nb: 2\n", "s:2:1", "keep one document"),
        ("a: 1\nb: x\x07y\n", "s:2:5", "plain UTF-8 text"),
    ],
)
def test_broken_yaml_names_place_and_remedy(text, place, words):
    with pytest.raises(InputError) as caught:
        parse_source(text, "s")
    assert str(caught.value).startswith(place + ": ")
    assert words in str(caught.value)


def test_a_missing_file_lists_its_neighbors(tmp_path):
    (tmp_path / "cheek.yaml").write_text("a: 1")
    with pytest.raises(InputError, match=r"no such scene file\n.*cheek\.yaml"):
        read_source(tmp_path / "cheeks.yaml")
    with pytest.raises(InputError, match="the folder '.*nowhere' does not exist either"):
        read_source(tmp_path / "nowhere" / "cheek.yaml")


def test_a_folder_is_no_scene(tmp_path):
    with pytest.raises(InputError, match="is a folder"):
        read_source(tmp_path)


def test_text_must_be_utf_8(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_bytes("a: 1\nb: \xb5m\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"s\.yaml:2:1: is not UTF-8 text \(byte 0xb5\)\n  save it as UTF-8"):
        read_source(path)
    path.write_bytes(b"\xef\xbb\xbfa: 1\n")
    assert read_source(path).data == {"a": 1}


def test_a_huge_file_is_refused(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match="larger than 1000 kB"):
        read_source(path)


def test_a_name_no_file_can_have_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="no such scene file"):
        read_source(tmp_path / ("x" * 5000 + ".yaml"))
