//! What a server is at.

/// Work that a server has for this tool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Job {
    /// The stepwise episode of this hash.
    Episode(String),
    /// The request of this number: a block or a batch.
    Request(u64),
}
