//! The simulation's code, called so that it cannot end the server.

use std::panic::{AssertUnwindSafe, catch_unwind};

use swarmwright_protocol::{MOST_REASON, MOST_STACK, shortened};
use swarmwright_worlds::Failure;

/// Runs the simulation's code; its panics become an error, so that one candidate cannot end the server.
///
/// # Errors
/// What the simulation said by [`fail`](swarmwright_worlds::fail), or that it panicked; short enough to be sent.
pub fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, Failure> {
    catch_unwind(AssertUnwindSafe(call)).map_err(|cause| {
        let Failure { reason, stack } = match cause.downcast::<Failure>() {
            Ok(failure) => *failure,
            Err(cause) => {
                let text = cause
                    .downcast_ref::<&str>()
                    .map(ToString::to_string)
                    .or_else(|| cause.downcast_ref::<String>().cloned())
                    .unwrap_or_else(|| "no reason given".to_owned());
                format!("the simulation panicked: {text}").into()
            }
        };
        Failure {
            reason: shortened(reason, MOST_REASON),
            stack: stack.map(|stack| shortened(stack, MOST_STACK)),
        }
    })
}

/// The fitness of an episode and the metrics of these names that follow it, if they can be sent.
///
/// # Errors
/// One of them is NaN or infinite.
pub(crate) fn all_finite<'a>(results: &'a [f64], metrics: &[String]) -> Result<&'a [f64], Failure> {
    let Some((&fitness, values)) = results.split_first() else {
        return Err("the simulation gives no fitness".to_owned().into());
    };
    finite(fitness)?;
    match metrics.iter().zip(values).find(|(_, v)| !v.is_finite()) {
        Some((name, value)) => {
            Err(format!("the simulation's metric {name} is {value}, not a finite number").into())
        }
        None => Ok(results),
    }
}

/// A fitness that can be sent.
///
/// # Errors
/// NaN or infinite.
pub(crate) fn finite(fitness: f64) -> Result<f64, Failure> {
    if fitness.is_finite() {
        Ok(fitness)
    } else {
        Err(format!("the simulation's fitness is {fitness}, not a finite number").into())
    }
}
