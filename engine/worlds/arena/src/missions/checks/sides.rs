//! The sides of a match.

use std::collections::BTreeMap;

use serde_json::Value;
use swarmwright_simulation::parameters::wrong;
use swarmwright_simulation::{ParameterError, Side};

use crate::metrics::Metric;
use crate::missions::text::SideText;
use crate::mistakes::{Mistakes, part};

/// Reads the sides. `metrics` is `None` if mistakes leave the metrics unknown.
pub(super) fn read(
    value: Option<&Value>,
    metrics: Option<&[(String, Metric)]>,
    mistakes: &mut Mistakes,
) -> Vec<Side> {
    let texts = value.map(|value| part::<BTreeMap<String, Value>>(value, "mission.sides"));
    let Some(texts) = texts.and_then(|texts| mistakes.take(texts)) else {
        return Vec::new();
    };
    if texts.len() < 2 {
        let reason = format!("{} found, expected at least two sides", texts.len());
        mistakes.add(wrong("mission.sides", reason));
    }
    let mut sides: Vec<Side> = Vec::new();
    for (name, value) in &texts {
        sides.extend(mistakes.take(side(name, value, metrics, &sides)));
    }
    sides
}

fn side(
    name: &str,
    value: &Value,
    metrics: Option<&[(String, Metric)]>,
    others: &[Side],
) -> Result<Side, ParameterError> {
    let at = format!("mission.sides.{name}");
    let text: SideText = part(value, &at)?;
    let groups = text.robots.unwrap_or_else(|| vec![name.to_owned()]);
    if groups.is_empty() {
        let reason = "an empty list found, expected at least one kind of robots";
        return Err(wrong(&format!("{at}.robots"), reason));
    }
    for (index, group) in groups.iter().enumerate() {
        let other = others
            .iter()
            .find(|side| side.groups.iter().any(|kind| kind == group));
        let twice = groups[..index].contains(group).then_some(name);
        if let Some(side) = other.map(|side| &side.name[..]).or(twice) {
            let reason = format!("{group:?} is already of the side {side:?}");
            return Err(wrong(&format!("{at}.robots"), reason));
        }
    }
    if let (Some(fitness), Some(metrics)) = (&text.fitness, metrics)
        && !metrics.iter().any(|(metric, _)| metric == fitness)
    {
        let names: Vec<&str> = metrics.iter().map(|(name, _)| &name[..]).collect();
        let names = names.join(", ");
        let reason = format!("no metric is named {fitness:?}; available: {names}");
        return Err(wrong(&format!("{at}.fitness"), reason));
    }
    Ok(Side {
        name: name.to_owned().into(),
        groups: groups.into_iter().map(Into::into).collect(),
        fitness: text.fitness.map(Into::into),
    })
}
