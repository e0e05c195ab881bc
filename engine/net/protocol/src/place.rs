//! Location of an error in a message: the path of the field.

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::{DecodeError, shortened};

/// Largest number of characters of a path, since its keys come from a peer.
const MOST_PATH: usize = 120;

/// Prepends the path of the field to an error, unless it concerns the whole message.
pub(crate) fn at(path: &str, words: &str) -> String {
    match path {
        "" | "." => words.to_owned(),
        path => format!("\"{}\": {words}", shortened(path.to_owned(), MOST_PATH)),
    }
}

/// Converts a value at a path of its message.
pub(crate) fn read<T: DeserializeOwned>(value: Value, path: &str) -> Result<T, DecodeError> {
    swarmwright_values::read(&value)
        .map_err(|mismatch| DecodeError::value(at(&mismatch.path_in(path), &mismatch.reason)))
}
