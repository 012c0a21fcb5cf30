"""Checks a campaign against what there is: rigs, stores, metrics, patterns; and builds the JSON schema for editors."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from configs import Campaign, CampaignFile, ConfigError, Document, InputError, Route, did_you_mean, read_campaign
from pipelines import PatternSet
from pipelines.change import METRICS
from storage import STORES

from .alarms import rule_of
from .area_plan import AXES_NEEDED
from .rigs import RIGS, STAGES, make_rig, make_stage, rig_options
from .scheduler import check_cron

__all__ = ["campaign_schema", "load_checked", "load_scheduled"]

Problem = tuple[Route, str]


def load_checked(path: str | Path) -> CampaignFile:
    """Read a campaign file and check every name in it.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    CampaignFile
        Paths among the rig's options are made relative to the file's folder, as all others are.

    Raises
    ------
    InputError
        If there is no such file.
    ConfigError
        If anything in it is wrong: one line per problem, ``FILE:LINE:COLUMN: KEY: what``.
    """
    file = read_campaign(path)
    campaign = _with_absolute_options(file.campaign, file.path.resolve().parent)
    _refuse(file.document, _problems(campaign))
    return CampaignFile(campaign, file.path, file.text, file.document)


def load_scheduled(path: str | Path) -> CampaignFile:
    """As `load_checked`, of a campaign that is to be run: an area is then visited unattended, again and again.

    Raises
    ------
    InputError, ConfigError
        As `load_checked`; also for what cannot be had with an area on a schedule.
    """
    file = load_checked(path)
    _refuse(file.document, _area_problems(file.campaign))
    return file


def _refuse(document: Document, problems: Iterable[Problem]) -> None:
    lines = [document.line(route, text, at_key=text.startswith("unknown")) for route, text in problems]
    if lines:
        raise ConfigError("\n".join(lines))


def _area_problems(campaign: Campaign) -> Iterator[Problem]:
    if campaign.area is None:
        return
    if campaign.schedule.video is not None:
        text = "follows one field of view: with an area give every or cron, or leave the area out"
        yield ("schedule", "video"), text
    if campaign.retain.raw_frames != "off":
        text = (
            "frames of an area's tiles are not kept: leave it off; "
            "`microrelief area CAMPAIGN --out DIR` keeps those of one scan"
        )
        yield ("retain", "raw_frames"), text
    if campaign.exposure is not None:
        yield ("exposure",), "would follow each tile of an area by itself: leave it out, and set the rig's own"
    if campaign.area.axes is None:
        yield ("area",), AXES_NEEDED


def _problems(campaign: Campaign) -> Iterator[Problem]:
    yield from _rig_problems(campaign)
    if campaign.store.kind not in STORES:
        known = list(STORES)
        yield ("store", "kind"), f"no store of kind {campaign.store.kind!r}{did_you_mean(campaign.store.kind, known)}"
    if campaign.schedule.cron is not None:
        try:
            check_cron(campaign.schedule.cron)
        except InputError as error:
            yield ("schedule", "cron"), str(error)
    if campaign.patterns is not None and not isinstance(campaign.patterns, Path):
        yield from _pattern_problems(dict(campaign.patterns))
    for index, name in enumerate(campaign.metrics):
        if name not in METRICS:
            yield ("metrics", index), f"no metric {name!r}{did_you_mean(name, list(METRICS))}"
    for index, alarm in enumerate(campaign.alarms):
        metric = METRICS.get(alarm.metric)
        if metric is not None and alarm.unit is not None and alarm.unit != metric.unit:
            yield ("alarms", index, "unit"), f"{alarm.metric} is in {metric.unit}, not {alarm.unit!r}"
        try:
            rule_of(alarm, campaign.environment)
        except ValueError as error:
            yield ("alarms", index), str(error)
    if campaign.area is not None:
        try:
            make_stage(campaign.area.stage)
        except InputError as error:
            yield ("area", "stage"), str(error).removeprefix("area.stage: ")
    if campaign.calibration.simulated and campaign.rig.name != "simulated":
        text = f"only the simulated rig can calibrate itself, not {campaign.rig.name!r}: give file: calibration.json"
        yield ("calibration", "simulated"), text


def _rig_problems(campaign: Campaign) -> Iterator[Problem]:
    rig = campaign.rig
    if rig.name not in RIGS:
        yield ("rig", "name"), f"no rig {rig.name!r}{did_you_mean(rig.name, list(RIGS))}"
        return
    known = rig_options(rig.name)
    unknown = [name for name in rig.options if name not in known]
    for name in unknown:
        yield ("rig", "options", name), f"unknown option{did_you_mean(str(name), list(known))}"
    if unknown:
        return
    try:
        make_rig(rig.name, rig.options)
    except InputError as error:
        named = re.match(r"rig option (\w+): (.*)", str(error), re.DOTALL)
        if named is not None:
            yield ("rig", "options", named[1]), named[2]
        else:
            yield ("rig", "options"), str(error)


def _pattern_problems(mapping: dict[str, Any]) -> Iterator[Problem]:
    try:
        PatternSet.from_mapping(mapping)
    except ValueError as error:
        named = re.match(r"(?:pattern(?: set)? )?([a-z_]+)\b", str(error))
        key = named[1] if named is not None and named[1] in mapping else None
        yield ("patterns", key) if key is not None else ("patterns",), str(error).removeprefix(f"{key}: ")


def _with_absolute_options(campaign: Campaign, folder: Path) -> Campaign:
    """Make the rig's paths relative to the campaign file."""
    make = RIGS.get(campaign.rig.name)
    if make is None:
        return campaign
    options = dict(campaign.rig.options)
    for name, parameter in inspect.signature(make).parameters.items():
        if "Path" in str(parameter.annotation) and isinstance(options.get(name), str):
            options[name] = str(folder / options[name])
    return campaign.model_copy(update={"rig": campaign.rig.model_copy(update={"options": options})})


def campaign_schema() -> dict[str, Any]:
    """Build the JSON schema of campaign files: every key, and every name that is registered.

    Returns
    -------
    dict
        JSON Schema, draft 2020-12.
    """
    schema = Campaign.model_json_schema(by_alias=True)
    parts = schema["$defs"]
    parts["RigSettings"]["properties"]["name"]["enum"] = list(RIGS)
    parts["RigSettings"]["allOf"] = [
        {
            "if": {"properties": {"name": {"const": name}}},
            "then": {"properties": {"options": _options_schema(name)}},
        }
        for name in RIGS
    ]
    parts["StoreSettings"]["properties"]["kind"]["enum"] = list(STORES)
    parts["Area"]["properties"]["stage"] |= {"properties": {"kind": {"enum": list(STAGES)}}, "required": ["kind"]}
    parts["Alarm"]["properties"]["metric"]["enum"] = list(METRICS)
    schema["properties"]["metrics"]["items"] = {
        "anyOf": [{"const": name, "description": f"{metric.title}, {metric.unit}"} for name, metric in METRICS.items()]
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "microrelief campaign",
        "description": "One site, one rig, one schedule, one recipe.",
        **{key: value for key, value in schema.items() if key not in ("title", "description")},
    }


def _options_schema(name: str) -> dict[str, Any]:
    """The options of a rig from its signature: their names, defaults, and the types that JSON can say."""
    options: dict[str, Any] = {}
    required = []
    for parameter in inspect.signature(RIGS[name]).parameters.values():
        option: dict[str, Any] = {}
        if parameter.default is inspect.Parameter.empty:
            required.append(parameter.name)
        else:
            default = parameter.default
            option["default"] = list(default) if isinstance(default, tuple) else default
            if isinstance(default, bool):
                option["type"] = "boolean"
            elif isinstance(default, int | float):
                option["type"] = "number"
            elif isinstance(default, str):
                option["type"] = "string"
        options[parameter.name] = option
    return {"type": "object", "additionalProperties": False, "properties": options, "required": required}
