//! Integration tests of this crate as one program, since each program links the whole engine anew.

mod audits;
mod broken;
mod common;
mod control;
mod conversations;
mod extensions;
mod failed;
mod lag;
mod layers;
mod narrow;
mod outages;
mod overtaken;
mod parameter_sets;
mod python_modules;
mod reconnections;
mod refusals;
mod retries;
mod samples;
mod shares;
mod sides;
mod sizes;
mod turns;
mod twins;
