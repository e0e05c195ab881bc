//! With a probability that shrinks with the number of neighbours.

use super::{Condition, Module};

pub(super) const MODULE: Module = Module {
    name: "few_neighbours",
    condition: Condition::Neighbours(-1.0),
};
