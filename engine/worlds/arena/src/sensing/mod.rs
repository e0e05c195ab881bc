//! Sensors of the robots.

pub(crate) mod camera;
mod grey;
mod ground;
mod light;
pub(crate) mod links;
mod messages;
mod neighbours;
mod objects;
mod others;
mod proximity;
pub(crate) mod radio;
pub(crate) mod senses;
mod slots;
pub(crate) mod verlet;
