//! Work under way on servers, by mode of evaluation.

pub(crate) mod batch;
pub(crate) mod episode;
pub(crate) mod requests;
pub(crate) mod stepwise;
