from __future__ import annotations

from command_line import call, summary_of

FEW = ("--set", "camera.pixels=[8,8]", "--photons", "500", "--photons", "2e3", "--seeds", "1", "--workers", "1")


def test_report_tells_what_it_wrote_and_goes_on(slab, tmp_path):
    out = tmp_path / "out"
    arguments = ("report", slab, *FEW, "--method", "beam", "--method", "beam:50", "-o", out)
    told = summary_of(call(*arguments, "--json"))
    assert (told["runs"], told["runs_new"], told["left_out"]) == (4, 4, [])
    plots = [f"{name}.{kind}" for name in ("error_vs_time", "color_difference", "stages", "pictures_1") for kind in ("png", "svg")]
    assert [path.rpartition("/")[2] for path in told["files"]] == ["index.html", "error_vs_time.csv", *plots, "table1.md"]
    scene = told["scenes"][0]
    assert scene["reference"]["kind"] == "reference" and scene["reference"]["photons"] == 40_000
    assert [(series["method"], series["gather_count"]) for series in scene["series"]] == [("beam", None), ("beam", 50)]
    level = scene["series"][0]["levels"][1]
    assert level["photons"] == 2000 and level["runs"] == 1 and level["relmse"]["stderr"] > 0
    again = call(*arguments)
    assert "4, of them 0 now" in again.stdout and "beam:50" in again.stdout


def test_bad_use_is_2_and_told(slab, tmp_path):
    for arguments, told in (
        (("--method", "path"), "--method: got 'path'"),
        ((slab,), "stands twice"),
        (("--target-seconds", "0"), "not in the range"),
    ):
        result = call("report", slab, *arguments, "-o", tmp_path)
        assert result.exit_code == 2 and told in result.stderr
    assert call("report").exit_code == 2


def test_a_scene_without_a_picture_is_2(slab, tmp_path):
    furrows = "relief.families=[{angle_deg: 0, spacing_mm: 0.5, depth_um: 30, width_um: 100}]"
    refracting = ("--set", "inner_borders=fresnel", "--set", "relief.kind=procedural", "--set", furrows)
    second = "    - {thickness_mm: 1, mu_a_per_mm: 1, mu_s_per_mm: 5, g: 0.5, refractive_index: 1.6}\nlight:"
    slab.write_text(slab.read_text().replace("light:", second, 1))
    result = call("report", slab, *FEW, *refracting, "-o", tmp_path / "out")
    assert result.exit_code == 2 and "there is no picture" in result.stderr
