//! Tests of Minisim's private parts. With the library compiled as a test, all lanes would be compiled a second time, which takes
//! a minute.

#![allow(dead_code, clippy::unwrap_used, reason = "only their tests are wanted")]

#[path = "../src/minisim/nearest.rs"]
mod nearest;
#[path = "../src/minisim/points.rs"]
mod points;

use points::{Point, squared_distance};
