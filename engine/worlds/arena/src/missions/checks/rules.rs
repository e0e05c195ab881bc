//! Rules of a mission, and the metrics that need them.

use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::FARTHEST;
use crate::metrics::Metric;
use crate::missions::text::Text;
use crate::mistakes::{Mistakes, items, part};
use crate::place::Place;
use crate::rules::{Capture, Restart, Rules};

/// Maximum number of captures in a mission.
const MOST_CAPTURES: usize = 16;

/// Reads the rules. `layout` is `None` if mistakes leave the place unknown.
pub(super) fn read(text: &Text, layout: Option<&Place>, mistakes: &mut Mistakes) -> Rules {
    let mut rules = Rules::default();
    for (at, capture) in items::<Capture>(text.captures.as_ref(), "mission.captures", mistakes) {
        mistakes.take(check_capture(&at, &capture));
        rules.captures.push(capture);
    }
    if rules.captures.len() > MOST_CAPTURES {
        let count = rules.captures.len();
        let reason = format!("{count} captures found, at most {MOST_CAPTURES} are possible");
        mistakes.add(wrong("mission.captures", reason));
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
    if !(0.0..=FARTHEST).contains(&capture.reach) {
        let reason = format!("{} found, expected 0 to {FARTHEST}", capture.reach);
        return Err(wrong(&format!("{at}.reach"), reason));
    }
    Ok(())
}

fn check_restart(at: &str, restart: &Restart, layout: &Place) -> Result<(), ParameterError> {
    let available = |names: Vec<&str>| match names.is_empty() {
        true => "none".to_owned(),
        false => names.join(", "),
    };
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
        if layout.patch(name).is_none() {
            let names = layout.patches.iter().map(|patch| &patch.name[..]);
            let available = available(names.collect());
            let reason = format!("no patch of the floor is named {name:?}; available: {available}");
            return Err(wrong(&format!("{at}.on[{index}]"), reason));
        }
    }
    Ok(())
}

/// Checks that metrics of captures have some.
pub(super) fn check_metrics(rules: &Rules, metrics: &[(String, Metric)], mistakes: &mut Mistakes) {
    for (name, metric) in metrics {
        if matches!(metric, Metric::Caught { .. }) && rules.captures.is_empty() {
            let reason = "the mission has no captures, so nobody is caught";
            mistakes.add(wrong(&format!("mission.metrics.{name}"), reason));
        }
    }
}
