from __future__ import annotations

from command_line import call, summary_of


def test_spectrum_of_a_slab(slab, tmp_path):
    arguments = ("spectrum", slab, "--stderr", "0.05", "--workers", "1", "-o", tmp_path / "out")
    told = summary_of(call(*arguments, "--json"))
    assert told["wavelength_nm"] == [550.0]
    for key in ("reflectance", "specular_excluded"):
        assert 0 < told[key][0]["value"] < 1 and told[key][0]["stderr"] > 0
    assert told["reflectance"][0]["value"] > told["specular_excluded"][0]["value"]
    assert (told["illuminant"], told["observer"]) == ("D65", "2")
    assert told["lab"].keys() == {"L", "a", "b"} and told["ita_deg"] is None and told["melanin_index"]["value"] is None
    assert [name.rpartition("/")[2] for name in told["files"]] == ["spectrum.csv", "spectrum.png"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"spectrum.csv", "spectrum.png", "timing.csv"}
    assert "L*a*b*" in call(*arguments).stdout


def test_seed_changes_the_photons_and_nothing_else(slab, tmp_path):
    first, second, again = (
        summary_of(call("spectrum", slab, "--stderr", "0.1", "--seed", seed, "-o", tmp_path, "--json"))
        for seed in (1, 2, 1)
    )
    assert first["reflectance"] == again["reflectance"] != second["reflectance"]
    assert first["photons_emitted"] == second["photons_emitted"]
