//! Who this process is at a broker.

use std::path::PathBuf;

use pyo3::PyResult;
use swarmwright_mqtt::Settings;

use crate::errors::input;

/// User name, password, and the PEM file of the authority that signed the broker's certificate.
pub type Account = (String, String, PathBuf);

/// Returns how the broker is reached: by this account, or with the credentials of the environment.
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
