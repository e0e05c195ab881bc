//! The exceptions: invalid input, and work that failed, mostly because there is no broker.

use std::fmt::Display;

use pyo3::PyErr;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use swarmwright_mqtt::ConnectError;

pyo3::create_exception!(
    swarmwright._engine,
    EngineError,
    PyRuntimeError,
    "An operation of the engine failed."
);
pyo3::create_exception!(
    swarmwright._engine,
    NoBrokerError,
    EngineError,
    "No broker answers at the address; a later attempt may succeed."
);
pyo3::create_exception!(
    swarmwright._engine,
    NoServerError,
    EngineError,
    "No server answered, not even an unsuitable one."
);
pyo3::create_exception!(
    swarmwright._engine,
    LostError,
    EngineError,
    "Messages of an episode or its server were lost; a later attempt may succeed."
);
pyo3::create_exception!(
    swarmwright._engine,
    InputError,
    PyValueError,
    "An argument is invalid."
);

/// The input is wrong.
pub fn input(error: impl Display) -> PyErr {
    InputError::new_err(error.to_string())
}

/// No connection to the broker came about: for now, or for good.
pub fn unconnected(error: &ConnectError) -> PyErr {
    match error {
        // Also what accepts and closes: a relay whose broker is still starting does.
        ConnectError::NoBroker { .. }
        | ConnectError::NoMqtt { .. }
        | ConnectError::Broken { .. }
        | ConnectError::Busy { .. } => NoBrokerError::new_err(error.to_string()),
        _ => engine(error),
    }
}

/// The work could not be done.
pub fn engine(error: impl Display) -> PyErr {
    EngineError::new_err(error.to_string())
}
