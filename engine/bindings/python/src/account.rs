//! The account of this process on a broker.

use std::path::PathBuf;

use pyo3::{PyResult, pyfunction};
use swarmwright_mqtt::Settings;

use crate::errors::input;

/// User name, password, and the PEM file of the authority that signed the broker's certificate.
pub type Account = (String, String, PathBuf);

/// User name and password with which this process connects to a broker.
#[pyfunction]
pub fn account(broker: &str) -> PyResult<(Option<String>, Option<String>)> {
    let settings = Settings::from_environment(broker).map_err(input)?;
    Ok((settings.username, settings.password))
}

/// Returns how the broker is reached: by this account, or with that of a broker of this user, or the credentials of the environment.
pub fn settings(broker: &str, account: Option<Account>) -> PyResult<Settings> {
    let Some((username, password, authority)) = account else {
        return Settings::from_environment(broker).map_err(input);
    };
    let mut settings = Settings::at(broker).map_err(input)?;
    settings.username = Some(username);
    settings.password = Some(password);
    settings.ca_file = Some(authority);
    Ok(settings)
}
