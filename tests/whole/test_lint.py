"""What reads the code: .ci/lint and the pre-commit hooks run the same tools, in the versions that pyproject.toml pins."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = SETTINGS["project"]
#: Tool -> requirement, 'ruff' -> 'ruff==0.17.6'.
PINS = {pin.partition("==")[0]: pin for pin in PROJECT["optional-dependencies"]["lint"]}
TOOL = r"(ruff \w+|[a-z][\w-]*)"


def hooks() -> list[tuple[str, list[str]]]:
    """(tool, what is installed for it) of each hook."""
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    found = []
    for hook in text.split("- id: ")[1:]:
        entry = re.search(rf"^ +entry: {TOOL}", hook, re.MULTILINE)[1]
        installed = re.search(r"additional_dependencies:\s+\[(.*?)\]", hook, re.DOTALL)[1]
        found.append((entry, re.split(r",\s*(?=[a-z])", installed)))
    return found


def test_hooks_and_lint_run_the_same_tools():
    lint = (ROOT / ".ci" / "lint").read_text(encoding="utf-8")
    asked = re.findall(rf"^good {TOOL}", lint, re.MULTILINE)
    assert asked == [tool for tool, _ in hooks()] and {tool.split()[0] for tool in asked} == set(PINS)
    assert re.findall(rf"^bad \S+ '.*?' {TOOL}", lint, re.MULTILINE) == asked, "each is first shown a bad file"
    assert re.search(r"^\.ci/lint\b", (ROOT / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE)


def test_hooks_install_the_pinned_versions():
    assert all("==" in pin for pin in PINS.values())
    for tool, installed in hooks():
        needed = (
            SETTINGS["build-system"]["requires"] + PROJECT["dependencies"] if tool == "mypy" else []
        )  # types come from them
        assert installed == [PINS[tool.split()[0]], *needed]
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    assert re.findall(r"- repo: (.*)", text) == ["local"], "nothing comes from another repository"
