//! Simulation wrapper (D6.1 5.2.2): serves a [`Simulation`] as a simulation server on the broker.
//!
//! ```no_run
//! # fn my_simulation() -> Box<dyn swarmwright_wrapper::Simulation> { unimplemented!() }
//! use swarmwright_wrapper::{Options, SimulationServer};
//!
//! let mut server = SimulationServer::connect(vec![my_simulation()], Options::new(7, "mqtt://localhost")?)?;
//! server.run(|event| println!("{event}"), || true);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//! [`machine`] decides how the server reacts to each message; it uses neither sockets nor clocks.

mod batch;
mod evaluator;
mod genomes;
mod group;
mod guard;
mod identity;
mod job;
pub mod machine;
mod notice;
mod progress;
mod run;
pub mod scenes;
mod server;

pub use genomes::gaussian;
pub use guard::guarded;
pub use identity::Identity;
pub use job::{Done, Job};
pub use machine::{Action, Machine, Notice};
pub use notice::Rival;
pub use progress::Progress;
pub use server::{Options, ServeError, SimulationServer};
pub use swarmwright_worlds::{
    Block, Body, Description, Determinism, Failure, Means, ParameterError, Parameters,
    RolloutError, Scene, Simulation, fail,
};
