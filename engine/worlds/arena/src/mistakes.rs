//! Collects all mistakes in parameters, so that they are reported together.

use serde::de::DeserializeOwned;
use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;
use swarmwright_values::Mismatch;

/// Mistakes in the order in which they were found, without those that only follow from another mistake.
#[derive(Debug, Default, PartialEq)]
pub struct Mistakes(Vec<ParameterError>);

impl From<ParameterError> for Mistakes {
    fn from(error: ParameterError) -> Self {
        Self(vec![error])
    }
}

impl Mistakes {
    /// Records the mistakes of a result, or returns its value.
    pub fn take<T>(&mut self, result: Result<T, impl Into<Self>>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(mistakes) => {
                self.0.extend(mistakes.into().0);
                None
            }
        }
    }

    /// Records a mistake.
    pub fn add(&mut self, mistake: ParameterError) {
        self.0.push(mistake);
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns the value if no mistakes were recorded.
    pub fn or<T>(self, value: Option<T>) -> Result<T, Self> {
        value.filter(|_| self.0.is_empty()).ok_or(self)
    }

    /// Applies `change` to each mistake.
    pub fn map(self, change: impl FnMut(ParameterError) -> ParameterError) -> Self {
        Self(self.0.into_iter().map(change).collect())
    }

    /// Returns the mistakes in the order in which they were recorded.
    pub fn into_all(self) -> Vec<ParameterError> {
        self.0
    }

    /// Returns the first mistake. If there is none, the reader failed to record a mistake, and the error is generic.
    pub fn into_first(self) -> ParameterError {
        let unknown = || ParameterError {
            name: String::new(),
            reason: "cannot be read".to_owned(),
        };
        self.0.into_iter().next().unwrap_or_else(unknown)
    }
}

/// Reads a value; `at` is its path in error messages.
pub fn part<T: DeserializeOwned>(value: &Value, at: &str) -> Result<T, ParameterError> {
    swarmwright_values::read(value).map_err(|mismatch| mismatch_at(at, mismatch))
}

/// Reads a list. Returns the valid items, each with its path.
pub fn items<T: DeserializeOwned>(
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

/// Returns an error whose name is prefixed with `path`.
pub fn with_place(path: &str, error: ParameterError) -> ParameterError {
    let name = match error.name.as_str() {
        "" => path.to_owned(),
        inner => format!("{path}.{inner}"),
    };
    wrong(&name, error.reason)
}

/// Returns an error about a value at `path` that does not match its type.
pub fn mismatch_at(path: &str, mismatch: Mismatch) -> ParameterError {
    wrong(&mismatch.path_in(path), mismatch.reason)
}
