//! Values of JSON as types of Rust, with errors in the words of those who write JSON and YAML.

mod strict;
mod suggestions;
mod words;

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use strict::Strict;

pub use strict::{Error, Segment};
pub use suggestions::did_you_mean;
pub use words::plain;

/// What is wrong with a value, and where in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mismatch {
    /// The path of the field, such as `walls.corners[2]`; empty for the value as a whole.
    pub path: String,
    /// What was found, and what is expected.
    pub reason: String,
}

impl Mismatch {
    /// The path of the field where the value as a whole is at a path.
    #[must_use]
    pub fn path_in(&self, location: &str) -> String {
        match (location, self.path.as_str()) {
            (location, "") => location.to_owned(),
            ("", path) => path.to_owned(),
            (location, path) if path.starts_with('[') => format!("{location}{path}"),
            (location, path) => format!("{location}.{path}"),
        }
    }
}

impl From<Error> for Mismatch {
    fn from(error: Error) -> Self {
        Self {
            path: path_in_words(error.path.iter().rev()),
            reason: plain(&error.reason),
        }
    }
}

/// Reads a value. Fields are read from an object, never from a list in the order of the type's fields.
///
/// # Errors
/// What does not fit, and where it is.
pub fn read<T: DeserializeOwned>(value: &Value) -> Result<T, Mismatch> {
    T::deserialize(Strict(value)).map_err(|error| mismatch(value, error))
}

fn mismatch(value: &Value, error: Error) -> Mismatch {
    // What was found is not in the words of types with a choice of forms, of which an object may be one.
    let part = at(value, error.path.iter().rev()).filter(|part| !part.is_object());
    let phrase = part.map(words::describe_value);
    let mut mismatch = Mismatch::from(error);
    if let Some(phrase) = phrase
        && mismatch.reason.starts_with("expected ")
    {
        mismatch.reason = format!("{phrase}, {}", mismatch.reason);
    }
    mismatch
}

/// Such as `walls.corners[2]`.
fn path_in_words<'a>(path: impl Iterator<Item = &'a Segment>) -> String {
    let mut words = String::new();
    for segment in path {
        match segment {
            Segment::Item(index) => words.push_str(&format!("[{index}]")),
            Segment::Field(key) => {
                if !words.is_empty() {
                    words.push('.');
                }
                words.push_str(key);
            }
        }
    }
    words
}

/// The value at a path.
fn at<'a>(value: &'a Value, mut path: impl Iterator<Item = &'a Segment>) -> Option<&'a Value> {
    path.try_fold(value, |value, segment| match segment {
        Segment::Item(index) => value.get(index),
        Segment::Field(key) => value.get(key),
    })
}

/// Reads an object whose field `kind` says which variant of `T` the others are fields of. `T` is an enum as serde tags it by
/// default, of variants with named fields: one that serde tags by `kind` itself would lose the paths of wrong fields.
///
/// # Errors
/// As [`read`].
pub fn read_kind<T: DeserializeOwned>(value: &Value) -> Result<T, Mismatch> {
    let wrong = |path: &str, reason: String| Mismatch {
        path: path.to_owned(),
        reason,
    };
    let Value::Object(fields) = value else {
        let phrase = words::describe_value(value);
        return Err(wrong(
            "",
            format!("{phrase}, expected an object with a kind"),
        ));
    };
    let mut fields = fields.clone();
    let kind = match fields.remove("kind") {
        Some(Value::String(kind)) => kind,
        Some(other) => {
            let phrase = words::describe_value(&other);
            return Err(wrong("kind", format!("{phrase}, expected a string")));
        }
        None => return Err(wrong("", "missing field `kind`".to_owned())),
    };
    let variant = Map::from_iter([(kind.clone(), Value::Object(fields))]);
    read(&Value::Object(variant)).map_err(|Mismatch { path, reason }| {
        let inner = path.strip_prefix(&kind).unwrap_or(&path);
        let unknown = inner.is_empty() && reason.starts_with(&format!("{kind:?} found"));
        let inner = if unknown { "kind" } else { inner };
        wrong(inner.strip_prefix('.').unwrap_or(inner), reason)
    })
}
