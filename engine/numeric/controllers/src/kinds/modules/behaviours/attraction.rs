//! Towards neighbours, by the state's parameter alpha, around obstacles.

use super::follow::{NONE, Pull};
use super::{Behaviour, Module};

pub(super) const MODULE: Module = Module {
    name: "attraction",
    behaviour: Behaviour::Follow(Pull {
        neighbours: 1.0,
        obstacles: -6.0,
        ..NONE
    }),
};
