"""What `fipt run` says of findings when it ends."""

from fipt.cli.run import tell_findings
from fipt.scene.findings import Measure, RoomFinding, write_findings


def test_headlines(tmp_path, capsys):
    measure = Measure("light off by", 0.31, 0.1)
    found = [RoomFinding("dark", "serious", "Light is missing.", measure, "Photograph the ceiling.")]
    write_findings(tmp_path / "findings.json", found, {})
    tell_findings(tmp_path)
    said = capsys.readouterr().err
    assert said.startswith(f"fipt: 1 finding (pictures: {tmp_path}/findings):\n")
    assert "serious: Light is missing. Photograph the ceiling." in said


def test_nothing_wrong(tmp_path, capsys):
    write_findings(tmp_path / "findings.json", [], {})
    tell_findings(tmp_path)
    assert capsys.readouterr().err == "fipt: nothing was found wrong\n"
