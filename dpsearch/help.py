"""The page that ``python train.py algo=xnes env=tiger --help`` prints: every setting, its value and its meaning."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from importlib.resources import files
from textwrap import fill, wrap
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dpsearch import config as schema
from dpsearch.options import meanings

WIDTH = 79
USAGE = """\
python train.py [GROUP=CHOICE ...] [SETTING=VALUE ...]     in a checkout
dpsearch-train [GROUP=CHOICE ...] [SETTING=VALUE ...]      once installed"""
INTRODUCTION = (
    "Trains a policy. Values below are those that the same command line without --help would have: add choices to it "
    "to see what they bring. With -m, a setting may have several values: -m seed=0,1,2 makes three runs."
)
SPELLING = {"None": "null", "True": "true", "False": "false"}
GROUPS = {
    "algo": "what learns",
    "env": "the task",
    "experiment": "settings of a result; they override the others",
    "tuned": "settings of an algorithm for a task, unless ~tuned",
}


def page(overrides: Sequence[str]) -> str:
    """The help page.

    Args:
        overrides: Choices and settings, in Hydra's way.

    Raises:
        RunError: If there is no such setting, or one of the algorithm is out of range.
        HydraException: If there is no such choice.
        OmegaConfBaseException: If a value is of the wrong type.
    """
    composed, choices = schema.compose(overrides)
    config = schema.completed(composed, choices, overrides)
    blocks = [USAGE, fill(INTRODUCTION, WIDTH)]
    blocks += ["Groups and their choices", *(_choices(group, choices.get(group)) for group in GROUPS)]
    blocks += ["Settings of the run", *_settings(config, "", schema.TrainConfig)]
    for section in schema.SECTIONS:
        kind: Any = OmegaConf.get_type(config, section)
        whose = f"{section}={choices[section]}" if section in choices else f"the {section}"
        blocks += [f"Settings of {whose}", *_settings(config, section, kind)]
    return "\n\n".join(blocks)


def _choices(group: str, chosen: str | None) -> str:
    """The choices of a group, the present one in brackets."""
    names = sorted(file.name.removesuffix(".yaml") for file in files("dpsearch.configs").joinpath(group).iterdir())
    words = " ".join(f"[{name}]" if name == chosen else name for name in names)
    return f"  {group}: {GROUPS[group]}\n" + _indented(words)


def _settings(config: DictConfig, section: str, kind: type[Any]) -> Iterator[str]:
    """Each setting of a section: its value, and what it means."""
    values = OmegaConf.select(config, section) if section else config
    meaning = meanings(kind)
    inner = _inner(schema.checked_section(config, "algo")) if section == "algo" else {}
    for setting in fields(kind):
        if section or setting.name not in schema.SECTIONS:
            name = f"{section}.{setting.name}" if section else setting.name
            yield _entry(name, _value(values, setting.name), meaning.get(setting.name, ""))
            for own, value, meant in inner.get(setting.name, ()):
                yield _entry(f"{name}.{own}", value, meant)


def _inner(settings: Any) -> dict[str, list[tuple[str, str, str]]]:
    """Name, value and meaning of the settings that a setting itself has, such as a baseline, by that setting's name."""
    found = {}
    for setting in fields(settings):
        if is_dataclass(value := getattr(settings, setting.name)):
            meaning = meanings(type(value))
            own = [field.name for field in fields(value) if field.init]
            found[setting.name] = [(name, _text(getattr(value, name)), meaning.get(name, "")) for name in own]
    return found


def _entry(name: str, value: str, meaning: str) -> str:
    return f"  {name}={value}\n" + _indented(meaning)


def _value(values: DictConfig, name: str) -> str:
    """A value as it would be given on the command line."""
    if OmegaConf.is_missing(values, name):
        return "???  (must be given)"
    try:
        value = values[name]
    except OmegaConfBaseException:  # it is computed from something that must be given
        return str(OmegaConf.to_container(values, resolve=False)[name])  # type: ignore[call-overload, index]
    return _text(OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value)


def _text(value: Any) -> str:
    """A value in Hydra's spelling."""
    if isinstance(value, dict):
        return "{" + ",".join(f"{key}:{_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(_text, value)) + "]"
    return SPELLING.get(str(value), str(value))


def _indented(text: str) -> str:
    """Wrapped lines, with values as YAML spells them."""
    text = re.sub(r"\b(None|True|False)\b", lambda found: SPELLING[found[0]], text)
    return "\n".join(wrap(text, WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6))
