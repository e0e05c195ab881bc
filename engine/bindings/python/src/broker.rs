//! The embedded broker.

use std::num::NonZeroU32;
use std::path::PathBuf;

use pyo3::prelude::*;
use swarmwright_broker::{Account, Broker, Config, Limits, certify};
use swarmwright_mqtt::Published;

use crate::errors::engine;

/// The embedded MQTT broker.
#[pyclass(name = "Broker", module = "swarmwright._engine")]
pub struct PyBroker {
    broker: Option<Broker>,
    url: String,
    socket_url: Option<String>,
    port: u16,
    /// Its account, where this user's programs find it.
    published: Option<Published>,
}

#[pymethods]
impl PyBroker {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "keywords, each with a default")]
    #[pyo3(signature = (host="127.0.0.1", port=Some(0), *, socket=None, socket_mode=0o600, websocket_port=None, users=None, accounts=None, access=None, certificate=None, key=None, client_ca=None, origins=None, rate=None, memory=None))]
    fn new(
        py: Python<'_>,
        host: &str,
        port: Option<u16>,
        socket: Option<PathBuf>,
        socket_mode: u32,
        websocket_port: Option<u16>,
        users: Option<PathBuf>,
        accounts: Option<Vec<(String, String)>>,
        access: Option<PathBuf>,
        certificate: Option<PathBuf>,
        key: Option<PathBuf>,
        client_ca: Option<PathBuf>,
        origins: Option<Vec<String>>,
        rate: Option<u32>,
        memory: Option<usize>,
    ) -> PyResult<Self> {
        let mut limits = Limits::default();
        limits.rate = rate.unwrap_or(limits.rate);
        limits.memory = memory.unwrap_or(limits.memory);
        let config = Config {
            host: host.to_owned(),
            port,
            socket,
            socket_mode,
            websocket_port,
            users,
            accounts: accounts
                .unwrap_or_default()
                .into_iter()
                .map(|(user, password)| Account { user, password })
                .collect(),
            access,
            certificate,
            key,
            client_ca,
            origins: origins.unwrap_or_default(),
            limits,
        };
        let broker = py.detach(|| Broker::start(&config)).map_err(engine)?;
        Ok(Self {
            url: broker.url(),
            socket_url: broker.socket_url(),
            port: broker.port(),
            broker: Some(broker),
            published: None,
        })
    }

    /// Publishes the account of the broker; returns a file for each of its addresses, or the reason why there are none.
    fn publish(
        &mut self,
        py: Python<'_>,
        user: String,
        password: String,
    ) -> (Vec<PathBuf>, Option<String>) {
        let Some(broker) = &self.broker else {
            return (Vec::new(), None);
        };
        let addresses = broker.addresses().collect();
        py.detach(|| {
            let account = (user, password);
            let mut published = Published::in_memory(addresses, &account);
            let problem = published.write(&account).err();
            let files = published.paths().map(Into::into).collect();
            self.published = Some(published);
            (files, problem.map(|error| error.to_string()))
        })
    }

    #[getter]
    fn url(&self) -> &str {
        &self.url
    }

    #[getter]
    fn socket_url(&self) -> Option<&str> {
        self.socket_url.as_deref()
    }

    #[getter]
    fn port(&self) -> u16 {
        self.port
    }

    fn reload(&self, py: Python<'_>) -> PyResult<()> {
        match &self.broker {
            Some(broker) => py.detach(|| broker.reload()).map_err(engine),
            None => Ok(()),
        }
    }

    fn stop(&mut self, py: Python<'_>) {
        let published = self.published.take();
        if let Some(broker) = self.broker.take() {
            py.detach(|| {
                broker.stop();
                drop(published);
            });
        }
    }
}

/// The argon2id hash of a password.
#[pyfunction]
pub fn hash_password(py: Python<'_>, password: &str) -> PyResult<String> {
    py.detach(|| swarmwright_broker::hash_password(password))
        .map_err(engine)
}

/// The `$7$` hash of a password.
#[pyfunction]
pub fn hash_for_mosquitto(
    py: Python<'_>,
    password: &str,
    iterations: NonZeroU32,
) -> PyResult<String> {
    py.detach(|| swarmwright_broker::hash_for_mosquitto(password, iterations))
        .map_err(engine)
}

/// An authority, its key, a certificate, its key.
#[pyfunction]
pub fn certificates(hosts: Vec<String>, days: i64) -> PyResult<(String, String, String, String)> {
    let bundle = certify(&hosts, days).map_err(engine)?;
    Ok((
        bundle.authority,
        bundle.authority_key,
        bundle.certificate,
        bundle.key,
    ))
}
