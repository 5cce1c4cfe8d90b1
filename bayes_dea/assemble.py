"""From a campaign and a model to a posterior: masks, noise terms, groups, what is left out and why."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .campaign.order import of, quantiles
from .campaign.schema import Campaign, Recording, Sensor
from .campaign.scratch import BLOCK, beside, computed, kept, pieces
from .errors import InputError
from .forward import memory, sign_of, simulate
from .likelihood.block_group import BlockGroup, build_block_groups
from .likelihood.interval_group import build_interval_groups
from .likelihood.linear_group import LinearGroup, build_linear_groups
from .likelihood.not_zeroed import with_free_offsets
from .likelihood.plant_group import build_plant_groups
from .likelihood.posterior import ChannelNoise, Posterior, ZeroPrior
from .likelihood.prepare import Prepared, RateClasses, prepare_all, rate_classes, rested
from .models.electrostatics import VOLTAGE_GEOMETRY, require
from .models.missing_drive import drive_values
from .models.model import Model, build_model
from .noise.edges import input_noise
from .noise.limit import limit_warning
from .noise.quiet import MOST_RHO, standard_errors
from .noise.stated import NoiseTerms, force_noise_from_position, noise_terms

_UNITS = {"displacement": "m", "force": "N"}
#: readings at rest from which on sampling rates are compared, and the ratio of what they scatter by that is said
_KNOWN, _UNLIKE = 4096, 1.4
#: correlation from which on noise may be slower than rests tell, the error of its size (in the logarithm) from which on
#: that is said, and a rest that tells it, in correlation times
_SLOW, _UNKNOWN, _RESTS = 0.95, 0.1, 500.0
#: recordings with drop-outs, or with readings that a sensor held, from which on these are said in one line
_MANY = 3
#: bytes a row (measured) while a model with effects works out its chain on the whole columns of a recording
_EFFECT_BYTES, _MENTIONED_BYTES = 60, 1e9
#: the slack before contact, as a share of the stack height: centre and sd of its prior
_SLACK_SHARE = 0.02


@dataclass(frozen=True)
class Assembled:
    """A posterior and what it was made of."""

    campaign: Campaign
    posterior: Posterior
    prepared: tuple[Prepared, ...]
    terms: Mapping[str, NoiseTerms]
    search_model: Model
    search_groups: tuple[LinearGroup, ...]
    warnings: tuple[str, ...]

    def refresh(self, posterior: Posterior, q: NDArray) -> Posterior:
        """The posterior with its within-block reference moved to the coordinates q (d,)."""
        return with_reference(posterior, q)

    @property
    def has_blocks(self) -> bool:
        """Whether anything is fitted through block means."""
        return any(isinstance(g, BlockGroup) for g in self.posterior.groups)


def assemble(
    campaign: Campaign,
    model: Model,
    workers: int = 1,
    report: Callable[[float, float, str], None] | None = None,
) -> Assembled:
    """Posterior of `model` on the recordings of `campaign` with role identify; those to validate are carried along.

    report: called with (done, of, name) as recordings are prepared. Raises InputError when geometry or sensors that the
    model needs are missing, or nothing is left to fit.
    """
    warnings: list[str] = list(campaign.warnings)
    used = _usable(campaign, model, warnings)
    if model.spec.effects:
        _check_room(used, model, warnings)
    for r in used:
        if r.is_voltage:
            require(r.actuator, VOLTAGE_GEOMETRY, f"{r.name} (a voltage recording)")
        else:
            require(r.actuator, ("stack_height_m", "total_area_m2"), f"{r.name} (a mechanical recording)")
    prepared = prepare_all(campaign, used, workers, report)
    warnings += _disturbances(prepared)
    if "sensor_clipping" not in model.spec.effects:
        warnings += _limits(prepared)
    voltage = tuple(p for p in prepared if p.recording.is_voltage)
    mechanical = tuple(p for p in prepared if p.recording.is_mechanical)
    terms: dict[str, NoiseTerms] = {}
    channels = []
    if voltage:
        terms.update(_voltage_terms(voltage, warnings))
        channels.append(_channel(voltage, terms, "displacement", warnings))
    if mechanical:
        force_terms, scatter = _force_terms(campaign, mechanical, warnings)
        terms.update(force_terms)
        channels.append(_channel(mechanical, terms, "force", warnings))
    rates = {c.channel: c.rates for c in channels}
    linear: list[LinearGroup] = []
    if voltage:
        if report is not None:
            report(0, len(voltage), "sums of recordings")
        linear = build_linear_groups(voltage, terms, rates["displacement"], workers, report)
    groups: list[LinearGroup | BlockGroup] = []
    if voltage:
        if model.spec.effects:
            groups += build_plant_groups(voltage, terms, rates["displacement"], "displacement")
        elif any(terms[p.name].interval_needed for p in voltage) and not model.is_black_box:
            groups += build_interval_groups(voltage, terms, rates["displacement"], "displacement")
        elif model.is_linear:
            groups += linear
        else:
            groups += build_block_groups(voltage, terms, rates["displacement"], "displacement")
    if mechanical:
        if model.spec.effects:
            groups += build_plant_groups(mechanical, terms, rates["force"], "force", scatter)
        elif any(terms[p.name].interval_needed for p in mechanical):
            groups += build_interval_groups(mechanical, terms, rates["force"], "force", scatter)
        else:
            groups += build_block_groups(mechanical, terms, rates["force"], "force", scatter)
    zeros = tuple(zero_prior(p) for p in mechanical if p.recording.role == "identify")
    # those to identify first; what one that was never fitted is made of is known where all parameters are shared
    specimens = tuple(dict.fromkeys(p.recording.specimen for p in sorted(prepared, key=lambda p: not _fitted(p))))
    own = _own_parameters(campaign, model, specimens)
    for p in prepared if own else ():
        if not any(_fitted(q) for q in prepared if q.recording.specimen == p.recording.specimen):
            raise InputError(
                f"{p.name}: specimen {p.recording.specimen} has parameters of its own ([share]) and no recording to "
                "identify; give it one, or share all parameters"
            )
    if own and model.spec.effects:
        raise InputError(f"[share] parameters: {model.name} has effects, which are calibrated with everything shared; "
                         "take [share] out or calibrate the specimens one by one")
    if own:
        model = replace(model, plain=True)
    posterior = Posterior(model, tuple(groups), tuple(channels), zeros, specimens, own)
    if not model.is_linear:
        search_model = linearised(model)
    else:
        search_model = replace(model, plain=False) if own else model
    return Assembled(
        campaign,
        posterior,
        prepared,
        terms,
        search_model,
        tuple(g for g in linear if g.fitted),
        tuple(dict.fromkeys(warnings)),
    )


def _usable(campaign: Campaign, model: Model, warnings: list[str]) -> tuple[Recording, ...]:
    used = []
    for r in campaign.recordings:
        if r.is_voltage or (r.is_mechanical and not model.is_black_box):
            used.append(r)
        elif r.is_mechanical:
            warnings.append(
                f"{r.name}: {model.name} is a black box from voltage to displacement and knows no force; "
                "the recording was left out"
            )
        else:
            warnings.append(f"{r.name}: kind '{r.kind}' was read but says nothing to {model.name}; it was left out")
    if not any(r.role == "identify" for r in used):
        raise InputError(
            f'{campaign.name}: no recording with role = "identify" that {model.name} can be fitted to; '
            "give at least one in campaign.toml"
        )
    return tuple(used)


def _check_room(used: tuple[Recording, ...], model: Model, warnings: list[str]) -> None:
    """Says what a model with effects needs for a long recording. Raises InputError where the machine has less."""
    longest = max(used, key=lambda r: r.n)
    need = _EFFECT_BYTES * longest.n
    if need < _MENTIONED_BYTES:
        return
    text = (f"{longest.name}: {model.name} has effects, which are worked out on the whole recording at once: its "
            f"{longest.n:.3g} rows need about {need / 1e9:.1f} GB of memory, whatever --memory says")
    names = getattr(os, "sysconf_names", {})
    known = "SC_PHYS_PAGES" in names and "SC_PAGE_SIZE" in names
    if known and need > (there := os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")):
        raise InputError(f"{text}, and this machine has {there / 1e9:.1f} GB. Cut the recording ([format] rows), thin "
                         "it out, or take a model without effects, which is fitted in pieces.")
    warnings.append(f"{text}.")


def _fitted(p: Prepared) -> bool:
    return p.recording.role == "identify"


def _own_parameters(campaign: Campaign, model: Model, specimens: tuple[str, ...]) -> tuple[int, ...]:
    """Positions of the parameters that specimens do not share; all are shared where [share] says nothing."""
    if campaign.share is None or len(specimens) < 2:
        return ()
    names = model.priors.names
    unknown = [n for n in campaign.share if n not in names and n not in model.priors.fixed]
    if unknown:
        raise InputError(f"[share] parameters: {model.name} has no {', '.join(unknown)}; it has {', '.join(names)}")
    return tuple(i for i, n in enumerate(names) if n not in campaign.share)


def linearised(model: Model) -> Model:
    """The structure without effects, Hooke's law in place of a bent one: where the search for it starts."""
    name = replace(model.spec, law=None if model.is_black_box else "hooke", effects=()).name
    linear = build_model(name)
    own = {p.name: p for p in model.parameters}
    kept = {
        p.name: own[p.name].prior
        for p in linear.parameters
        if p.name in own
        and not own[p.name].fixed
        and own[p.name].prior.relative_to is None
        and own[p.name].prior.is_log
    }
    return build_model(name, kept)


def _disturbances(prepared: Sequence[Prepared]) -> list[str]:
    """What was found in the readings: drop-outs and held readings, in one line where many recordings have some, and
    mains."""
    spoiled = [p for p in prepared if p.dropouts]
    if len(spoiled) < _MANY:
        out = [f"{p.name}: {_count(p.dropouts)} ({_share([p])} of the samples) found and masked" for p in spoiled]
    else:
        total = sum(p.dropouts for p in spoiled)
        each = ", ".join(f"{p.name} {p.dropouts}" for p in spoiled)
        found = f"{_count(total)} ({_share(spoiled)} of the samples)"
        out = [f"{found} found and masked in {len(spoiled)} recordings: {each}"]
    stuck = [p for p in prepared if p.stuck]
    if len(stuck) < _MANY:
        out += [
            f"{p.name}: its sensor held a value where it should scatter, {p.stuck} readings in all; they are masked. "
            "Check the sensor"
            for p in stuck
        ]
    else:
        each = ", ".join(f"{p.name} {p.stuck}" for p in stuck)
        out.append(
            f"in {len(stuck)} recordings the sensor held a value where it should scatter; these readings are masked: "
            f"{each}. Check the sensor"
        )
    for p in prepared:
        if p.mains is not None:
            how = "was found and is modelled"
            if p.mains.taken_over:
                how = "is in the other recordings and modelled here, too"
            out.append(
                f"{p.name}: mains at {p.mains.frequency_Hz:.3f} Hz with an amplitude of {p.mains.amplitude:.3g} "
                f"{_UNITS[p.channel]} {how}"
            )
    return out


def _limits(prepared: Sequence[Prepared]) -> list[str]:
    """Where readings stop at the end of a sensor's range: one of the displacement reads all recordings."""
    seen = [p for p in prepared if p.channel == "displacement"]
    if not seen:
        return []
    resolution = max(p.sensor.resolution or 0.0 for p in seen)
    said = limit_warning({p.name: p.y for p in seen}, resolution, _UNITS["displacement"])
    return [] if said is None else [said]


def _count(dropouts: int) -> str:
    return "1 drop-out" if dropouts == 1 else f"{dropouts} drop-outs"


def _share(prepared: Sequence[Prepared]) -> str:
    """Share of the samples that are drop-outs."""
    return f"{sum(p.dropouts for p in prepared) / sum(p.y.size for p in prepared):.2g}"


def _voltage_terms(prepared: tuple[Prepared, ...], warnings: list[str]) -> dict[str, NoiseTerms]:
    largest = max(p.signal() for p in prepared)
    quiet = float(np.median([p.quiet_sd for p in rested(prepared)]))
    out = {}
    for p in prepared:
        out[p.name] = noise_terms(p.sensor, p.recording.zeroed, largest, estimated_sd=quiet)
        warnings += out[p.name].warnings
    out, told = with_free_offsets(prepared, out)
    warnings += told
    return out


def _force_terms(
    campaign: Campaign, prepared: tuple[Prepared, ...], warnings: list[str]
) -> tuple[dict[str, NoiseTerms], dict[str, float]]:
    """Noise terms of the forces, and the variance that the scatter of the position adds to a sample."""
    largest = max(p.signal() for p in prepared)
    quiet = float(np.median([p.quiet_sd for p in rested(prepared)]))
    stated = campaign.sensors.get("position", Sensor())
    stiffness = float(np.median([_stiffness(p) for p in prepared]))
    travel = max(
        float(np.nanmax(p.recording.columns["position_m"]) - np.nanmin(p.recording.columns["position_m"]))
        for p in prepared
    )
    carried = force_noise_from_position(stated, stiffness, travel)
    warnings += carried.warnings
    terms, scatter = {}, {}
    for p in prepared:
        own = noise_terms(p.sensor, p.recording.zeroed, largest, estimated_sd=quiet, channel="force")
        warnings += own.warnings
        # the systematic part of the position is the zero, a parameter of its own, and a gain like that of the force
        terms[p.name] = replace(own, gain_sd=float(np.hypot(own.gain_sd, carried.gain_sd)))
        # the recorded scatter is evidence, the stated one a promise
        seen = input_noise(drive_values(p.recording))
        scatter[p.name] = (stiffness * seen) ** 2
    return terms, scatter


def _stiffness(p: Prepared) -> float:
    """Largest force over the travel that goes with it, in N/m."""
    x = kept(drive_values(p.recording), p.observed)
    low, high = quantiles(of(kept(p.y, p.observed)), [0.001, 0.999])
    return max((high - low) / max(float(x.max() - x.min()), 1e-9), 1e-9)


def _channel(
    prepared: tuple[Prepared, ...], terms: Mapping[str, NoiseTerms], channel: str, warnings: list[str]
) -> ChannelNoise:
    fitted = [p for p in prepared if p.recording.role == "identify"] or list(prepared)
    # a rate at which nothing is fitted has no rho of its own: it takes that of the nearest rate
    rates = rate_classes(tuple(fitted))
    first = terms[fitted[0].name]
    sd = float(np.median([p.quiet_sd for p in rested(fitted, prepared)]))
    guess = []
    for i in range(len(rates.steps_s)):
        ours, all_of_them = ([p for p in some if rates.of(p) == i] for some in (fitted, prepared))
        members = [p.quiet_rho for p in rested(ours, all_of_them) if np.isfinite(p.quiet_rho)]
        guess.append(float(np.median(members)) if members else 0.0)
    if sd > 2.5 * first.sigma_median or sd < first.sigma_median / 2.5:
        warnings.append(
            f"[sensor.{channel}] states a fluctuation of {first.sigma_median:.3g} {_UNITS[channel]}; quiet "
            f"stretches of the recordings scatter by {sd:.3g}. The recordings decide, but check the statement."
        )
    warnings += _unlike_rates(fitted, rates, _UNITS[channel]) + _short_rests(fitted, channel)
    return ChannelNoise(
        channel,
        _UNITS[channel],
        first.sigma_median,
        first.sigma_log_sd,
        rates,
        sd if np.isfinite(sd) and sd > 0 else first.sigma_median,
        tuple(guess),
    )


def _unlike_rates(fitted: Sequence[Prepared], rates: RateClasses, unit: str) -> list[str]:
    """A line on sampling rates at which a sensor scatters unlike at others: their recordings share one sigma."""
    known = [p for p in fitted if p.quiet_n >= _KNOWN]
    levels = {
        step: float(np.median(own))
        for i, step in enumerate(rates.steps_s)
        if (own := [p.quiet_sd for p in known if rates.of(p) == i])
    }
    if len(levels) < 2:
        return []
    calm, noisy = min(levels, key=levels.__getitem__), max(levels, key=levels.__getitem__)
    if levels[noisy] < _UNLIKE * levels[calm]:
        return []
    return [
        f"at rest, readings every {1e3 * noisy:.3g} ms scatter by {levels[noisy]:.3g} {unit}, those every "
        f"{1e3 * calm:.3g} ms by {levels[calm]:.3g} {unit}: all are weighed by one size of the noise, with a "
        "correlation for each rate, so that some count for more or for less than they say; where a controller averages "
        "for the slower record, record all at one rate, or average the others alike"
    ]


def _short_rests(fitted: Sequence[Prepared], channel: str) -> list[str]:
    """A line where noise is correlated over so long that what was read at rest does not tell how large it is."""
    known = [p for p in rested(fitted) if p.quiet_n]
    slow = max(known, key=lambda p: p.reading_step_s / (1.0 - min(p.quiet_rho, MOST_RHO)), default=None)
    if slow is None or slow.quiet_rho < _SLOW:
        return []
    error = standard_errors([p.quiet_n for p in known], [p.quiet_rho for p in known])[0]
    lasts_s = slow.reading_step_s / (1.0 - min(slow.quiet_rho, MOST_RHO))
    if error < _UNKNOWN:
        return []
    return [
        f"the noise of the {channel} is correlated over {1e3 * lasts_s:.2g} ms, and recordings stand still too shortly "
        f"to tell its size to better than {100 * error:.0f} %: record a rest of {_RESTS * lasts_s:.2g} s and more"
    ]


def zero_prior(p: Prepared) -> ZeroPrior:
    position = drive_values(p.recording)
    height = p.recording.actuator.stack_height_m or 1.0
    sign = float(sign_of(kept(p.y, p.observed)))
    sd = _SLACK_SHARE * height
    return ZeroPrior(p.name, f"zero_{_identifier(p.name)}_m", float(position[0]) + sign * sd, sd)


def _identifier(name: str) -> str:
    stem = name.rsplit(".", 1)[0]
    return "".join(ch if ch.isalnum() else "_" for ch in stem)


def with_reference(posterior: Posterior, q: NDArray) -> Posterior:
    """The posterior whose block groups take the level and correlation of the noise from the full residual at q."""
    q = np.atleast_2d(q)
    zeros = {k: float(v[0]) for k, v in posterior.zeros_part(q).items()}
    groups: list[LinearGroup | BlockGroup] = []
    for group in posterior.groups:
        if isinstance(group, LinearGroup):
            groups.append(group)
            continue
        sigma, rho = posterior.noise_part(q, group.channel)
        z = posterior.model_part(q, group.specimen)
        values = {k: float(v[0]) for k, v in posterior.model.physical(z).items()}
        gain = float(group.evaluate(posterior.model, z, posterior.zeros_part(q), sigma, rho)[0, 1])
        recordings = [r.prepared.recording for r in group.records]
        residuals = {}
        for record in group.records:
            p = record.prepared
            if p.recording.role != "identify":
                continue
            x = simulate(posterior.model, values, p.recording, zeros.get(p.name), memory(recordings, p.recording))
            residuals[p.name] = remove_nuisance(p, computed(lambda y, x, gain=gain: y - (1 + gain) * x, p.y, x))
            del x
        groups.append(group.with_reference(residuals))
    return replace(posterior, groups=tuple(groups))


def remove_nuisance(p: Prepared, residual: NDArray) -> NDArray:
    """A residual without the offset and the mains line that fit it best."""
    N = p.nuisance()
    good = computed(lambda seen, r: seen & np.isfinite(r), p.observed, residual, dtype=np.bool_)
    if residual.size <= BLOCK:
        coefficient, *_ = np.linalg.lstsq(N[good], residual[good], rcond=None)
    else:
        # the triangular factor of all rows, from those of the pieces
        R = np.empty((0, N.shape[1] + 1))
        for part in pieces(residual.size, BLOCK):
            here = np.column_stack([N[part], residual[part]])[good[part]]
            R = np.asarray(np.linalg.qr(np.concatenate([R, here]), mode="r"))
        coefficient, *_ = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=None)
    out = beside(residual)
    for part in pieces(out.size, BLOCK):
        out[part] = residual[part] - N[part] @ coefficient
    return out
