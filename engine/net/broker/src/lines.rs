//! Text files of one entry a line, with comments.

use crate::BrokerError;
use std::path::Path;

/// Reads a file and gives `take` the trimmed content of each line that is neither empty nor a comment (`#`).
/// What `take` says is wrong is reported with file and line.
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
