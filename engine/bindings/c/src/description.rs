//! What a simulation says of itself.

use std::ffi::c_char;

use swarmwright_worlds::{Description, Determinism, MetricInfo};

use crate::error::Trouble;
use crate::input::{self, Structure};

/// More numbers in a message than this are a slip.
const MOST_NUMBERS: u32 = 1_000_000;
/// Longest title, bytes.
const LONGEST_TITLE: usize = 1000;

/// `swarmwright_metric`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct RawMetric {
    name: *const c_char,
    unit: *const c_char,
    description: *const c_char,
}

/// `swarmwright_description`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct RawDescription {
    size: usize,
    title: *const c_char,
    dimensions: u32,
    max_agents: u32,
    sensors: u32,
    actuators: u32,
    metrics: *const RawMetric,
    metric_count: usize,
    determinism: i32,
    tolerance: f64,
}

// SAFETY: as `Structure` asks.
unsafe impl Structure for RawDescription {
    const NAME: &'static str = "swarmwright_description";
}

/// Checks a title.
///
/// # Errors
/// It is empty or too long.
pub(crate) fn check_title(title: &str) -> Result<(), Trouble> {
    if title.is_empty() || title.len() > LONGEST_TITLE {
        return Err(Trouble::Invalid(format!(
            "the title has {} bytes, expected 1 to {LONGEST_TITLE}",
            title.len()
        )));
    }
    Ok(())
}

/// Reads a description.
///
/// # Errors
/// No title, no sensors or actuators, metrics whose names are none.
///
/// # Safety
/// `pointer` is null or points to a description as the header describes it.
pub(crate) unsafe fn read(pointer: *const RawDescription) -> Result<Description, Trouble> {
    // SAFETY: as the caller promises.
    let (raw, title, metrics) = unsafe {
        let raw = input::structure(pointer)?;
        let title = input::text("swarmwright_description.title", raw.title)?;
        let metrics = input::items(
            "swarmwright_description.metrics",
            raw.metrics,
            raw.metric_count,
        )?;
        (raw, title, metrics)
    };
    check_title(title)?;
    for (field, count) in [("sensors", raw.sensors), ("actuators", raw.actuators)] {
        if !(1..=MOST_NUMBERS).contains(&count) {
            return Err(Trouble::Invalid(format!(
                "{title}: {count} {field}, expected 1 to {MOST_NUMBERS}"
            )));
        }
    }
    // SAFETY: as the caller promises.
    let metrics = unsafe { read_metrics(title, metrics)? };
    Ok(Description {
        title: title.to_owned(),
        dimensions: raw.dimensions,
        max_agents: Some(raw.max_agents).filter(|most| *most > 0),
        sensors: raw.sensors as usize,
        actuators: raw.actuators as usize,
        metrics: metrics.into(),
        determinism: determinism(title, raw.determinism, raw.tolerance)?,
    })
}

pub(crate) fn determinism(
    title: &str,
    declared: i32,
    tolerance: f64,
) -> Result<Determinism, Trouble> {
    Ok(match declared {
        0 => Determinism::Undeclared,
        1 => Determinism::Bitwise,
        2 if tolerance.is_finite() && tolerance >= 0.0 => Determinism::Statistical(tolerance),
        2 => {
            return Err(Trouble::Invalid(format!(
                "{title}: the tolerance is {tolerance}, expected a finite number of at least 0"
            )));
        }
        3 => Determinism::None,
        _ => {
            return Err(Trouble::Invalid(format!(
                "{title}: the determinism is {declared}, expected one of SWARMWRIGHT_UNDECLARED, _BITWISE, _STATISTICAL, _NONE"
            )));
        }
    })
}

/// # Safety
/// Their texts are null or end with NUL.
unsafe fn read_metrics(title: &str, metrics: &[RawMetric]) -> Result<Vec<MetricInfo>, Trouble> {
    let mut read: Vec<MetricInfo> = Vec::with_capacity(metrics.len());
    for metric in metrics {
        // SAFETY: as the caller promises.
        let (name, unit, description) = unsafe {
            (
                input::text("swarmwright_metric.name", metric.name)?,
                input::optional("swarmwright_metric.unit", metric.unit)?,
                input::optional("swarmwright_metric.description", metric.description)?,
            )
        };
        if !is_name(name) || name == "fitness" {
            return Err(Trouble::Invalid(format!(
                "{title}: metric {name:?}: a name must be a letter or _, then letters, digits and _, and not fitness"
            )));
        }
        if read.iter().any(|other| other.name == name) {
            return Err(Trouble::Invalid(format!(
                "{title}: metric {name:?} occurs twice"
            )));
        }
        read.push(MetricInfo {
            name: name.to_owned().into(),
            unit: unit.unwrap_or_default().to_owned().into(),
            description: description.unwrap_or_default().to_owned().into(),
        });
    }
    Ok(read)
}

fn is_name(text: &str) -> bool {
    let mut bytes = text.bytes();
    bytes
        .next()
        .is_some_and(|b| b.is_ascii_alphabetic() || b == b'_')
        && bytes.all(|b| b.is_ascii_alphanumeric() || b == b'_')
}
