//! Sensors of the robots.

pub mod camera;
mod grey;
mod ground;
mod light;
pub mod links;
mod messages;
mod neighbours;
mod objects;
mod others;
mod proximity;
pub mod radio;
pub mod senses;
mod slots;
pub mod verlet;
