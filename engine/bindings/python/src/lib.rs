//! Python bindings of the engine: the module `swarmwright._engine`, described in `_engine.pyi`.

mod account;
mod arrays;
mod broker;
mod cma;
mod controller;
mod conversation;
mod digests;
mod episodes;
mod errors;
mod evolution;
mod genomes;
mod lanes;
mod local;
mod log;
mod methods;
mod modules;
mod operators;
mod physics;
mod pool;
mod producer;
mod remote;
mod results;
mod sample;
mod sampling;
mod scenes;
mod selection;
mod server;
mod simulation;
mod statistics;
mod streams;
mod supervision;
mod threads;
mod values;
mod watch;
mod worlds;

use pyo3::prelude::*;
use swarmwright_pool::{Faults, Timeouts};

use crate::values::to_python;

#[pymodule]
fn _engine(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    // The defaults of these sections of an experiment file.
    module.add("TIMEOUTS", to_python(module.py(), &Timeouts::default())?)?;
    module.add("FAULTS", to_python(module.py(), &Faults::default())?)?;
    module.add("EngineError", module.py().get_type::<errors::EngineError>())?;
    module.add(
        "NoBrokerError",
        module.py().get_type::<errors::NoBrokerError>(),
    )?;
    module.add(
        "NoServerError",
        module.py().get_type::<errors::NoServerError>(),
    )?;
    module.add("LostError", module.py().get_type::<errors::LostError>())?;
    module.add("InputError", module.py().get_type::<errors::InputError>())?;
    module.add_class::<controller::PyController>()?;
    module.add_class::<worlds::PyEpisode>()?;
    module.add_class::<episodes::PyEpisodes>()?;
    module.add_class::<broker::PyBroker>()?;
    module.add_function(wrap_pyfunction!(account::account, module)?)?;
    module.add_function(wrap_pyfunction!(broker::hash_password, module)?)?;
    module.add_function(wrap_pyfunction!(broker::hash_for_mosquitto, module)?)?;
    module.add_function(wrap_pyfunction!(broker::certificates, module)?)?;
    module.add_class::<pool::PyPool>()?;
    module.add_class::<supervision::PySupervision>()?;
    module.add_function(wrap_pyfunction!(log::log_to, module)?)?;
    module.add_function(wrap_pyfunction!(log::log_line, module)?)?;
    module.add_class::<watch::PyWatcher>()?;
    module.add_class::<scenes::PyRemoteEpisode>()?;
    module.add_class::<streams::PyStream>()?;
    module.add_class::<streams::PyStreams>()?;
    module.add_class::<evolution::PyGrowingNetwork>()?;
    module.add_class::<evolution::PyNodeNetwork>()?;
    module.add_class::<cma::PyCma>()?;
    module.add_class::<methods::PySearch>()?;
    module.add_class::<producer::PyProducer>()?;
    module.add_class::<digests::PyDigests>()?;
    module.add_function(wrap_pyfunction!(statistics::aggregates, module)?)?;
    module.add_function(wrap_pyfunction!(statistics::figures, module)?)?;
    module.add_function(wrap_pyfunction!(statistics::outcome, module)?)?;
    module.add_function(wrap_pyfunction!(evolution::distances, module)?)?;
    module.add_class::<selection::PyRanks>()?;
    module.add_class::<selection::PyTorus>()?;
    module.add_function(wrap_pyfunction!(selection::distinct, module)?)?;
    module.add_function(wrap_pyfunction!(selection::survivors, module)?)?;
    module.add_class::<sample::PySample>()?;
    module.add_function(wrap_pyfunction!(sampling::centered_ranks, module)?)?;
    module.add_function(wrap_pyfunction!(sampling::utilities, module)?)?;
    module.add_function(wrap_pyfunction!(sampling::exp, module)?)?;
    module.add_function(wrap_pyfunction!(sampling::log, module)?)?;
    module.add_function(wrap_pyfunction!(controller::genome_size, module)?)?;
    module.add_function(wrap_pyfunction!(worlds::simulations, module)?)?;
    module.add_function(wrap_pyfunction!(worlds::describe, module)?)?;
    module.add_function(wrap_pyfunction!(worlds::missions, module)?)?;
    module.add_function(wrap_pyfunction!(worlds::robots, module)?)?;
    module.add_function(wrap_pyfunction!(physics::rays, module)?)?;
    module.add_function(wrap_pyfunction!(worlds::parameter_mistakes, module)?)?;
    module.add_function(wrap_pyfunction!(worlds::steers_itself, module)?)?;
    module.add_function(wrap_pyfunction!(genomes::decimals, module)?)?;
    module.add_class::<local::PyEvaluator>()?;
    module.add_function(wrap_pyfunction!(local::evaluate, module)?)?;
    module.add_function(wrap_pyfunction!(simulation::evaluate_host, module)?)?;
    module.add_function(wrap_pyfunction!(local::levels, module)?)?;
    module.add_function(wrap_pyfunction!(local::check_instructions, module)?)?;
    module.add_function(wrap_pyfunction!(server::serve, module)?)?;
    module.add_function(wrap_pyfunction!(watch::servers, module)?)?;
    module.add_function(wrap_pyfunction!(watch::forget, module)?)?;
    Ok(())
}
