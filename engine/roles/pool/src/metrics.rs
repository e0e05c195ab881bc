//! Metrics: values of an episode that the experiment's fitness needs besides the simulation's own fitness.

/// Returns the named metrics of one evaluation, in the order of `names`; `value` looks up one metric.
///
/// # Errors
/// Fails if a metric is missing, NaN or infinite; the evaluation has then failed.
pub(crate) fn needed(
    names: &[String],
    value: impl Fn(&str) -> Option<f64>,
) -> Result<Vec<f64>, String> {
    let read = |name: &String| match value(name) {
        Some(value) if value.is_finite() => Ok(value),
        Some(value) => Err(format!("the metric {name} is {value}, not a finite number")),
        None => Err(format!("the metric {name} is missing from the result")),
    };
    names.iter().map(read).collect()
}

/// Returns why a server that announces only `announced` cannot provide `needed`; `None` if it can.
pub(crate) fn unannounced(needed: &[String], announced: &[String]) -> Option<String> {
    let missing = || needed.iter().filter(|name| !announced.contains(name));
    let plural = match missing().count() {
        0 => return None,
        1 => "",
        _ => "s",
    };
    let missing = missing().map(String::as_str).collect::<Vec<_>>().join(", ");
    let offer = if announced.is_empty() {
        "announces none".to_owned()
    } else {
        format!("announces {}", announced.join(", "))
    };
    Some(format!(
        "does not announce the metric{plural} {missing}, which the fitness needs (it {offer})"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn what_is_missing_or_not_finite_is_named() {
        let look_up = |name: &str| match name {
            "a" => Some(1.0),
            "b" => Some(f64::NAN),
            _ => None,
        };
        assert_eq!(needed(&names(&["a", "a"]), look_up), Ok(vec![1.0, 1.0]));
        assert_eq!(needed(&[], look_up), Ok(vec![]));
        let wrong = |name| needed(&names(&["a", name]), look_up).unwrap_err();
        assert!(wrong("b").contains("b is NaN"), "{}", wrong("b"));
        assert!(wrong("c").contains("c is missing"), "{}", wrong("c"));
    }

    #[test]
    fn a_server_must_announce_all_that_is_needed() {
        let wrong =
            |needed: &[&str], announced: &[&str]| unannounced(&names(needed), &names(announced));
        assert_eq!(wrong(&["a"], &["b", "a"]), None);
        assert_eq!(wrong(&[], &[]), None);
        let reason = wrong(&["a", "c"], &["b", "a"]).unwrap();
        assert!(
            reason.contains("metric c,") && reason.contains("(it announces b, a)"),
            "{reason}"
        );
        assert!(
            wrong(&["a", "c"], &[])
                .unwrap()
                .contains("metrics a, c, which")
        );
    }
}
