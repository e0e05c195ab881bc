//! The integration tests of this crate as one program: each program links the whole engine anew.

mod arena;
mod arena_batteries;
mod arena_bodies;
mod arena_cameras;
mod arena_drives;
mod arena_failures;
mod arena_grippers;
mod arena_kinds;
mod arena_lanes;
mod arena_metrics;
mod arena_mistakes;
mod arena_objects;
mod arena_physics;
mod arena_polygons;
mod arena_presets;
mod arena_radio;
mod arena_robots;
mod arena_sides;
mod contacts_parts;
