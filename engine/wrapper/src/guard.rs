//! The simulation's code, called so that it cannot end the server.

use std::panic::{AssertUnwindSafe, catch_unwind};

use swarmwright_worlds::Failure;

/// Runs the simulation's code; its panics become an error, so that one candidate cannot end the server.
///
/// # Errors
/// What the simulation said by [`fail`](swarmwright_worlds::fail), or that it panicked.
pub fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(call)).map_err(|cause| {
        if let Some(Failure(reason)) = cause.downcast_ref() {
            return reason.clone();
        }
        let text = cause
            .downcast_ref::<&str>()
            .map(ToString::to_string)
            .or_else(|| cause.downcast_ref::<String>().cloned());
        format!(
            "the simulation panicked: {}",
            text.unwrap_or_else(|| "no reason given".to_owned())
        )
    })
}

/// The fitness of an episode and the metrics of these names that follow it, if they can be sent.
///
/// # Errors
/// One of them is NaN or infinite.
pub(crate) fn all_finite<'a>(results: &'a [f64], metrics: &[String]) -> Result<&'a [f64], String> {
    let Some((&fitness, values)) = results.split_first() else {
        return Err("the simulation gives no fitness".to_owned());
    };
    finite(fitness)?;
    match metrics.iter().zip(values).find(|(_, v)| !v.is_finite()) {
        Some((name, value)) => Err(format!(
            "the simulation's metric {name} is {value}, not a finite number"
        )),
        None => Ok(results),
    }
}

/// A fitness that can be sent.
///
/// # Errors
/// NaN or infinite.
pub(crate) fn finite(fitness: f64) -> Result<f64, String> {
    if fitness.is_finite() {
        Ok(fitness)
    } else {
        Err(format!(
            "the simulation's fitness is {fitness}, not a finite number"
        ))
    }
}
