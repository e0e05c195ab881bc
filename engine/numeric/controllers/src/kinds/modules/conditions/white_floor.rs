//! On white ground, with a probability.

use super::{Condition, Ground, Module};

pub(super) const MODULE: Module = Module {
    name: "white_floor",
    condition: Condition::Ground(Ground::White),
};
