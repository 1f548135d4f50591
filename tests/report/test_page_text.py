"""The page as one file: its policy, and text of files that stays text."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pytest

import priorfill as pf
from priorfill.report import page
from priorfill.report.page import content_policy, page_json, page_text
from priorfill.report.report_data import page_data
from priorfill.synthetic.demo import make_demo_clip

HOSTILE = (
    "</script><img src=x onerror=alert(1)>",
    "<!--<script>",
    "{{data}}{{script}}",
    "\u202eEVIL\u2066",
    "\x1b[31m\x00\u2028",
    "L" * 10_000,
    "'\"&lt;",
)


def parts(text: str) -> dict[str, str]:
    """The elements of a page by what they hold."""
    found = {
        "style": re.findall(r"<style>(.*?)</style>", text, re.DOTALL),
        "data": re.findall(r'id="priorfill-data">(.*?)</script>', text, re.DOTALL),
        "packed": re.findall(r'id="priorfill-script">(.*?)</script>', text, re.DOTALL),
        "loader": re.findall(r"<script>(.*?)</script>", text, re.DOTALL),
        "policy": re.findall(r'Security-Policy" content="(.*?)"', text),
    }
    assert all(len(values) == 1 for values in found.values())
    return {name: values[0] for name, values in found.items()}


def digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def hostile_result() -> pf.Result:
    rng = np.random.default_rng(0)
    positions = rng.normal(0.0, 1.0, (30, len(HOSTILE), 3)).cumsum(axis=0)
    positions[10:15, 0] = np.nan
    clip = pf.Clip(positions, HOSTILE, 100.0, name=HOSTILE[0], subject=HOSTILE[3])
    return pf.fill(clip, method="linear", options=pf.FillOptions(estimate_errors=False))


def test_the_policy_has_the_hashes_of_what_runs() -> None:
    found = parts(page_text(page_data(pf.fill(make_demo_clip()[1], method="linear"))))
    script = zlib.decompress(base64.b64decode(found["packed"])).decode()
    rules = dict(rule.strip().split(" ", 1) for rule in found["policy"].split(";"))
    expected = {
        "default-src": "'none'",
        "script-src": f"'sha256-{digest(found['loader'])}' 'sha256-{digest(script)}'",
        "style-src": f"'sha256-{digest(found['style'])}'",
        "img-src": "data: blob:",
        "connect-src": "'none'",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    assert rules == expected
    connected = content_policy(connect=True)
    assert connected == "; ".join(
        f"{name} {value}" for name, value in (expected | {"connect-src": "'self'"}).items()
    )
    assert parts(page_text({"title": ""}, connect=True))["policy"] == connected
    assert script.rstrip().endswith("})();")
    assert script.index("class Store") < script.index("startPage();")


def test_text_of_files_is_data() -> None:
    data = page_data(hostile_result())
    found = parts(page_text(data))
    assert not set("<>&\u2028") & set(found["data"])
    assert found["data"].isascii()
    assert json.loads(found["data"]) == data
    labels = [marker["label"] for marker in data["markers"]]
    assert labels[0] == HOSTILE[0]
    assert labels[3] == "\\u202eEVIL\\u2066"
    assert labels[4] == "\\x1b[31m\\x00\\u2028"
    assert max(map(len, labels)) <= 80
    assert [marker["raw"] for marker in data["markers"]] == list(HOSTILE)


def test_places_of_the_template_are_filled_once() -> None:
    text = page_text(page_data(hostile_result()) | {"title": "{{data}}<b>é"})
    assert "<title>&#123;&#123;data" in text or "<title>{{data}}&#60;b&#62;&#233;</title>" in text
    assert "{{data}}{{script}}" in text  # as a label
    assert "{{csp}}" not in text
    assert "{{packed}}" not in text


def test_numbers_without_a_value_are_refused() -> None:
    with pytest.raises(ValueError, match="JSON"):
        page_json({"rate": float("nan")})


def test_the_scripts_are_safe_inside_the_page() -> None:
    folder = Path(page.__file__).parent / "page"
    for path in sorted(folder.glob("*.js")):
        content = path.read_text(encoding="utf-8")
        assert "</script" not in content, path.name
        assert "<!--" not in content, path.name
    assert "</style" not in (folder / "page.css").read_text(encoding="utf-8")
