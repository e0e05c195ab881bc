//! Evaluations: queue, results, and attribution of failures.

pub(crate) mod blame;
pub(crate) mod ledger;
pub(crate) mod piece;
pub(crate) mod results;
