//! Evaluations: which are queued, which are done, what is held against them.

pub(crate) mod blame;
pub(crate) mod ledger;
pub(crate) mod piece;
pub(crate) mod results;
