//! Collects what is wrong with parameters, so that all of it is told at once.

use serde::de::DeserializeOwned;
use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;
use swarmwright_values::Mismatch;

/// Mistakes in the order in which they were found; what would only follow from another one is not among them.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Mistakes(Vec<ParameterError>);

impl From<ParameterError> for Mistakes {
    fn from(error: ParameterError) -> Self {
        Self(vec![error])
    }
}

impl Mistakes {
    /// Notes what is wrong; the value where nothing is.
    pub(crate) fn take<T>(&mut self, result: Result<T, impl Into<Self>>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(mistakes) => {
                self.0.extend(mistakes.into().0);
                None
            }
        }
    }

    pub(crate) fn add(&mut self, mistake: ParameterError) {
        self.0.push(mistake);
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// A value, if nothing was wrong with it.
    pub(crate) fn or<T>(self, value: Option<T>) -> Result<T, Self> {
        value.filter(|_| self.0.is_empty()).ok_or(self)
    }

    /// The same where complaints name places of `change`.
    pub(crate) fn map(self, change: impl FnMut(ParameterError) -> ParameterError) -> Self {
        Self(self.0.into_iter().map(change).collect())
    }

    pub(crate) fn into_all(self) -> Vec<ParameterError> {
        self.0
    }

    /// The first one; there is none only where a value is missing and nothing was noted, which is a fault here.
    pub(crate) fn into_first(self) -> ParameterError {
        let unknown = || ParameterError {
            name: String::new(),
            reason: "cannot be read".to_owned(),
        };
        self.0.into_iter().next().unwrap_or_else(unknown)
    }
}

/// Reads a value at a place.
pub(crate) fn part<T: DeserializeOwned>(value: &Value, at: &str) -> Result<T, ParameterError> {
    swarmwright_values::read(value).map_err(|mismatch| mismatch_at(at, mismatch))
}

/// Reads a list: the items that can be read, each with its place.
pub(crate) fn items<T: DeserializeOwned>(
    list: Option<&Value>,
    at: &str,
    mistakes: &mut Mistakes,
) -> Vec<(String, T)> {
    let values = list.and_then(|list| mistakes.take(part::<Vec<Value>>(list, at)));
    let values = values.unwrap_or_default();
    let item = |(index, value): (usize, &Value)| {
        let at = format!("{at}[{index}]");
        let item = mistakes.take(part(value, &at))?;
        Some((at, item))
    };
    values.iter().enumerate().filter_map(item).collect()
}

/// An error about a part of the value at `path`.
pub(crate) fn with_place(path: &str, error: ParameterError) -> ParameterError {
    let name = match error.name.as_str() {
        "" => path.to_owned(),
        inner => format!("{path}.{inner}"),
    };
    wrong(&name, error.reason)
}

/// The same of what does not fit its type.
pub(crate) fn mismatch_at(path: &str, mismatch: Mismatch) -> ParameterError {
    wrong(&mismatch.path_in(path), mismatch.reason)
}
