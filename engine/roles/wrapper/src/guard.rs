//! Guards against failures of the simulation's code.

use std::panic::{AssertUnwindSafe, catch_unwind};

use swarmwright_protocol::{MOST_REASON, MOST_STACK, shortened};
use swarmwright_worlds::Failure;

/// Runs the simulation's code and converts its panics into errors, so that one candidate cannot end the server.
///
/// # Errors
/// Returns the reason given by [`fail`](swarmwright_worlds::fail) or the panic message, shortened for a message.
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

/// Checks the fitness of an episode, followed by the metrics with these names.
///
/// # Errors
/// Fails if a value is NaN or infinite, or if there is no fitness.
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

/// Checks a fitness.
///
/// # Errors
/// Fails if it is NaN or infinite.
pub(crate) fn finite(fitness: f64) -> Result<f64, Failure> {
    if fitness.is_finite() {
        Ok(fitness)
    } else {
        Err(format!("the simulation's fitness is {fitness}, not a finite number").into())
    }
}
