//! Stays where it is.

use super::{Behaviour, Module};

pub(super) const MODULE: Module = Module {
    name: "stop",
    behaviour: Behaviour::Stop,
};
