//! Accounts of this user's brokers, which connections find by the broker's address.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use common::subscription;
use swarmwright_broker::{Account, Broker, Config};
use swarmwright_mqtt::{ConnectError, Connection, Published, Settings};

#[test]
fn connections_of_this_process_use_a_published_account() {
    let (user, password) = ("run".to_owned(), "a random password".to_owned());
    let broker = Broker::start(&Config {
        accounts: vec![Account {
            user: user.clone(),
            password: password.clone(),
        }],
        ..Config::default()
    })
    .unwrap();
    let urls = [broker.url(), format!("mqtt://LocalHost:{}", broker.port())];
    let open = |url: &str| {
        let settings = Settings::from_environment(url).unwrap();
        Connection::open(settings, subscription("t"))
    };
    let refused = || {
        let error = open(&urls[0]).err().unwrap();
        assert!(matches!(error, ConnectError::Refused { .. }), "{error}");
    };
    refused();
    let published = Published::in_memory(broker.addresses().collect(), &(user, password));
    for url in &urls {
        assert!(open(url).is_ok(), "{url}");
    }
    // Remote brokers do not get the password.
    let list = format!("{},mqtt://192.0.2.1", broker.url());
    assert_eq!(Settings::from_environment(&list).unwrap().password, None);
    drop(published);
    refused();
}
