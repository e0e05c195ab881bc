//! Jobs of a server.

/// Work that a server does for this tool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Job {
    /// A stepwise episode with this hash.
    Episode(String),
    /// A request with this number: a block or a batch.
    Request(u64),
}
