//! Away from neighbours, by the square of the state's parameter alpha, around obstacles.

use super::follow::{NONE, Pull};
use super::{Behaviour, Module};

pub(super) const MODULE: Module = Module {
    name: "repulsion",
    behaviour: Behaviour::Follow(Pull {
        squared: -1.0,
        obstacles: -5.0,
        ..NONE
    }),
};
