//! With a probability that grows with the number of neighbours.

use super::{Condition, Module};

pub(super) const MODULE: Module = Module {
    name: "neighbours",
    condition: Condition::Neighbours(1.0),
};
