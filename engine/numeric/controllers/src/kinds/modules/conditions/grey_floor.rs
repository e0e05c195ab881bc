//! On grey ground, with a probability.

use super::{Condition, Ground, Module};

pub(super) const MODULE: Module = Module {
    name: "grey_floor",
    condition: Condition::Ground(Ground::Grey),
};
