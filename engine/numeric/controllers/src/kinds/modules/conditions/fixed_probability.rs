//! With a probability.

use super::{Condition, Module};

pub(super) const MODULE: Module = Module {
    name: "fixed_probability",
    condition: Condition::Fixed,
};
