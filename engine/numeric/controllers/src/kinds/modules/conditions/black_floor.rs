//! On black ground, with a probability.

use super::{Condition, Ground, Module};

pub(super) const MODULE: Module = Module {
    name: "black_floor",
    condition: Condition::Ground(Ground::Black),
};
