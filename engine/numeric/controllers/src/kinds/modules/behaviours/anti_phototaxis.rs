//! Anti-phototaxis: moves away from the light, around obstacles.

use super::follow::{NONE, Pull};
use super::{Behaviour, Module};

pub(super) const MODULE: Module = Module {
    name: "anti_phototaxis",
    behaviour: Behaviour::Follow(Pull {
        light: -1.0,
        obstacles: -5.0,
        ..NONE
    }),
};
