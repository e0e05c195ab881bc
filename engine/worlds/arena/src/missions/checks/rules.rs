//! Rules of a mission, and the metrics that need them.

use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::FARTHEST;
use crate::metrics::Metric;
use crate::missions::text::Text;
use crate::mistakes::{Mistakes, items, part};
use crate::place::Place;
use crate::rules::{Capture, Flag, Restart, Rules};

/// Maximum number of captures and of flags in a mission.
const MOST: usize = 16;

/// Reads the rules. `layout` is `None` if mistakes leave the place unknown.
pub(super) fn read(text: &Text, layout: Option<&Place>, mistakes: &mut Mistakes) -> Rules {
    let mut rules = Rules::default();
    for (at, capture) in items::<Capture>(text.captures.as_ref(), "mission.captures", mistakes) {
        mistakes.take(check_capture(&at, &capture));
        rules.captures.push(capture);
    }
    for (at, flag) in items::<Flag>(text.flags.as_ref(), "mission.flags", mistakes) {
        mistakes.take(check_flag(&at, &flag, &rules.flags, layout));
        rules.flags.push(flag);
    }
    for (name, count) in [
        ("captures", rules.captures.len()),
        ("flags", rules.flags.len()),
    ] {
        if count > MOST {
            let reason = format!("{count} {name} found, at most {MOST} are possible");
            mistakes.add(wrong(&format!("mission.{name}"), reason));
        }
    }
    let at = "mission.restart";
    let restart = text
        .restart
        .as_ref()
        .map(|value| part::<Restart>(value, at));
    rules.restart = mistakes.take(restart.transpose()).flatten();
    if let (Some(restart), Some(layout)) = (&rules.restart, layout) {
        mistakes.take(check_restart(at, restart, layout));
    }
    rules
}

fn check_capture(at: &str, capture: &Capture) -> Result<(), ParameterError> {
    if capture.robots == capture.by {
        let reason = "a kind of robots does not catch itself; name two kinds";
        return Err(wrong(&format!("{at}.by"), reason));
    }
    check_reach(at, capture.reach)
}

fn check_reach(at: &str, reach: f32) -> Result<(), ParameterError> {
    if (0.0..=FARTHEST).contains(&reach) {
        return Ok(());
    }
    let reason = format!("{reach} found, expected 0 to {FARTHEST}");
    Err(wrong(&format!("{at}.reach"), reason))
}

fn check_flag(
    at: &str,
    flag: &Flag,
    others: &[Flag],
    layout: Option<&Place>,
) -> Result<(), ParameterError> {
    if others.iter().any(|other| other.name == flag.name) {
        let reason = format!(
            "another flag is already named {:?}; choose another name",
            flag.name
        );
        return Err(wrong(&format!("{at}.name"), reason));
    }
    if flag.robots == flag.lost_to {
        let reason = "a kind of robots does not take flags from itself; name two kinds";
        return Err(wrong(&format!("{at}.lost_to"), reason));
    }
    check_reach(at, flag.reach)?;
    if let Some(layout) = layout {
        check_patch(&format!("{at}.base"), &flag.base, layout)?;
        check_patch(&format!("{at}.home"), &flag.home, layout)?;
    }
    if flag.base == flag.home {
        let reason = "base and home must be different patches";
        return Err(wrong(&format!("{at}.home"), reason));
    }
    Ok(())
}

/// Checks that there is a patch with this name; `at` is the place that names it.
fn check_patch(at: &str, name: &str, layout: &Place) -> Result<(), ParameterError> {
    if layout.patch(name).is_some() {
        return Ok(());
    }
    let names = layout.patches.iter().map(|patch| &patch.name[..]);
    let available = available(names.collect());
    let reason = format!("no patch of the floor is named {name:?}; available: {available}");
    Err(wrong(at, reason))
}

fn available(names: Vec<&str>) -> String {
    match names.is_empty() {
        true => "none".to_owned(),
        false => names.join(", "),
    }
}

fn check_restart(at: &str, restart: &Restart, layout: &Place) -> Result<(), ParameterError> {
    let objects: Vec<&str> = layout.objects.iter().map(|kind| &kind.name[..]).collect();
    if !objects.contains(&&restart.object[..]) {
        let (name, available) = (&restart.object, available(objects));
        let reason = format!("no object is named {name:?}; available: {available}");
        return Err(wrong(&format!("{at}.object"), reason));
    }
    if restart.on.is_empty() {
        let reason = "an empty list found, expected at least one patch";
        return Err(wrong(&format!("{at}.on"), reason));
    }
    for (index, name) in restart.on.iter().enumerate() {
        check_patch(&format!("{at}.on[{index}]"), name, layout)?;
    }
    Ok(())
}

/// Checks that the rules have what metrics of captures and flags name.
pub(super) fn check_metrics(rules: &Rules, metrics: &[(String, Metric)], mistakes: &mut Mistakes) {
    for (name, metric) in metrics {
        let at = format!("mission.metrics.{name}");
        match metric {
            Metric::Caught { .. } if rules.captures.is_empty() => {
                let reason = "the mission has no captures, so nobody is caught";
                mistakes.add(wrong(&at, reason));
            }
            Metric::FlagsBrought { .. } | Metric::FlagsCarried { .. } if rules.flags.is_empty() => {
                mistakes.add(wrong(&at, "the mission has no flags"));
            }
            Metric::FlagsBrought { flag: Some(flag) }
            | Metric::FlagsCarried {
                flag: Some(flag), ..
            } if rules.flags.iter().all(|other| other.name != *flag) => {
                let names = rules.flags.iter().map(|flag| &flag.name[..]);
                let names = available(names.collect());
                let reason = format!("no flag is named {flag:?}; available: {names}");
                mistakes.add(wrong(&format!("{at}.flag"), reason));
            }
            _ => {}
        }
    }
}
