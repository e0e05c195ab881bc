//! Text files with one entry per line, and comments.

use crate::BrokerError;
use std::path::Path;

/// Passes the trimmed content of each line of a file to `take`, except empty lines and comments (`#`). Errors of `take`
/// are reported with file and line.
pub fn each(
    path: &Path,
    purpose: &'static str,
    mut take: impl FnMut(&str) -> Result<(), String>,
) -> Result<(), BrokerError> {
    let text = std::fs::read_to_string(path).map_err(|source| BrokerError::Unreadable {
        purpose,
        path: path.into(),
        source,
    })?;
    for (index, line) in text.lines().map(str::trim).enumerate() {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        take(line).map_err(|wrong| BrokerError::Invalid {
            purpose,
            path: path.into(),
            line: Some(index + 1),
            wrong,
        })?;
    }
    Ok(())
}
