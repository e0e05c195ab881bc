//! Passwords, access rules, TLS.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

use crate::common;

use common::{CONNACK, Client, Hello, in_time, packet, text};
use rustls::pki_types::{CertificateDer, ServerName, pem::PemObject};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use std::net::TcpStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use swarmwright_broker::{Account, Broker, Config};

fn data(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name)
}

#[test]
fn passwords_admit_and_refuse() {
    in_time(|| {
        let broker = Broker::start(&Config {
            users: Some(data("users")),
            ..Config::default()
        })
        .unwrap();
        // CONNACK codes of 3.1.1 and 5.0: bad user name or password, not authorized.
        for (version, bad, missing) in [(4, 4, 5), (5, 0x86, 0x87)] {
            let code = |user| {
                Client::knock(
                    &broker,
                    &Hello {
                        version,
                        user,
                        ..Hello::default()
                    },
                )
                .1
            };
            assert_eq!(code(Some(("ada", "correct horse"))), 0);
            assert_eq!(code(Some(("bob", "plain password"))), 0);
            assert_eq!(code(Some(("ada", "wrong horse"))), bad);
            assert_eq!(code(Some(("bob", "correct horse"))), bad);
            assert_eq!(code(Some(("eve", ""))), bad);
            assert_eq!(code(None), missing);
        }
    });
}

fn private(socket: Option<PathBuf>) -> Config {
    Config {
        accounts: vec![Account {
            user: "run".to_owned(),
            password: "a random password".to_owned(),
        }],
        socket,
        ..Config::default()
    }
}

#[test]
fn accounts_admit_their_clients_alone() {
    in_time(|| {
        let broker = Broker::start(&private(None)).unwrap();
        for (version, refused) in [(4, 5), (5, 0x87)] {
            let code = |user| {
                let hello = Hello {
                    version,
                    user,
                    ..Hello::default()
                };
                Client::knock(&broker, &hello).1
            };
            assert_eq!(code(Some(("run", "a random password"))), 0);
            for wrong in ["a random passwore", "a random password ", "a", ""] {
                assert_eq!(code(Some(("run", wrong))), refused);
            }
            assert_eq!(code(Some(("eve", "a random password"))), refused);
            assert_eq!(code(None), refused);
        }
    });
}

#[test]
fn guesses_do_not_delay_the_clients_of_an_account() {
    in_time(|| {
        let broker = Broker::start(&private(None)).unwrap();
        let began = Instant::now();
        for guess in 0..2000 {
            let hello = Hello {
                user: Some(("run", &guess.to_string())),
                ..Hello::default()
            };
            assert_eq!(Client::knock(&broker, &hello).1, 0x87);
        }
        let hello = Hello {
            user: Some(("run", "a random password")),
            ..Hello::default()
        };
        assert_eq!(Client::knock(&broker, &hello).1, 0);
        // With slow hashes, 8 wrong passwords per second are checked for a network.
        assert!(began.elapsed() < Duration::from_secs(50));
    });
}

#[cfg(unix)]
#[test]
fn clients_of_a_unix_socket_need_no_account() {
    in_time(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broker.sock");
        let broker = Broker::start(&private(Some(path.clone()))).unwrap();
        let stream = std::os::unix::net::UnixStream::connect(&path).unwrap();
        let mut client = Client::over(stream, &Hello::default());
        assert_eq!(client.expect(CONNACK)[1], 0);
        assert_eq!(Client::knock(&broker, &Hello::default()).1, 0x87);
    });
}

#[test]
fn a_password_file_and_accounts_exclude_each_other() {
    let config = Config {
        users: Some(data("users")),
        ..private(None)
    };
    let error = Broker::start(&config).expect_err("both are given");
    assert!(error.to_string().contains("not both"), "{error}");
}

#[test]
fn a_refused_client_is_disconnected_and_cannot_publish() {
    in_time(|| {
        let broker = Broker::start(&Config {
            users: Some(data("users")),
            ..Config::default()
        })
        .unwrap();
        let mut reader = Client::join(
            &broker,
            &Hello {
                user: Some(("bob", "plain password")),
                ..Hello::default()
            },
        );
        reader.subscribe("#", 0);
        let stream = TcpStream::connect(("127.0.0.1", broker.port())).unwrap();
        let mut eve = Client::new(stream, true);
        let hello = Hello {
            user: Some(("bob", "guess")),
            will: Some(("t", "will before CONNACK")),
            ..Hello::default()
        };
        let mut bytes = hello.bytes();
        bytes.extend(eve.message("t", true, &[], b"message before CONNACK"));
        eve.send(&bytes);
        assert_eq!(eve.expect(CONNACK)[1], 0x86);
        assert_eq!(eve.next(), None);
        reader.publish("t", false, b"friend");
        assert_eq!(reader.hear_payload(), "friend");
    });
}

#[test]
fn access_rules_decide_who_reads_and_writes() {
    in_time(|| {
        let config = Config {
            users: Some(data("users")),
            access: Some(data("access")),
            ..Config::default()
        };
        let broker = Broker::start(&config).unwrap();
        let mut ada = Client::join(
            &broker,
            &Hello {
                user: Some(("ada", "correct horse")),
                ..Hello::default()
            },
        );
        let mut bob = Client::join(
            &broker,
            &Hello {
                id: "tool",
                user: Some(("bob", "plain password")),
                ..Hello::default()
            },
        );
        ada.subscribe("#", 0);
        bob.subscribe("#", 0);
        // Bob may read below swarm/ but write nothing there; no client may read swarm/secret, retained or not.
        bob.publish("swarm/forged", false, b"forged");
        ada.publish("swarm/secret", true, b"secret");
        ada.publish("swarm/news", false, b"news");
        assert_eq!(ada.hear_payload(), "news");
        assert_eq!(bob.hear_payload(), "news");
        // Use QoS 1, so that the refusal is reported: not authorized.
        let mut body = text("swarm/forged");
        body.extend([0, 9, 0]);
        bob.send(&packet(0x32, &body));
        assert_eq!(bob.expect(0x40), [0, 9, 0x87]);
        bob.subscribe("swarm/secret", 0);
        ada.publish("swarm/news", false, b"more");
        assert_eq!(bob.hear_payload(), "more");
    });
}

/// Creates files with a self-signed certificate for 127.0.0.1 and its key.
fn certificate(folder: &tempfile::TempDir) -> (PathBuf, PathBuf) {
    let certificate =
        rcgen::generate_simple_self_signed(["127.0.0.1".into(), "localhost".into()]).unwrap();
    let paths = (
        folder.path().join("certificate.pem"),
        folder.path().join("key.pem"),
    );
    std::fs::write(&paths.0, certificate.cert.pem()).unwrap();
    std::fs::write(&paths.1, certificate.signing_key.serialize_pem()).unwrap();
    paths
}

type Secure = StreamOwned<ClientConnection, TcpStream>;

fn secure(broker: &Broker, roots: RootCertStore) -> Secure {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap();
    let config = config.with_root_certificates(roots).with_no_client_auth();
    let name = ServerName::try_from("127.0.0.1").unwrap();
    let stream = TcpStream::connect(("127.0.0.1", broker.port())).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    StreamOwned::new(
        ClientConnection::new(Arc::new(config), name).unwrap(),
        stream,
    )
}

#[test]
fn tls_carries_large_and_many_messages_and_turns_plain_clients_away() {
    in_time(|| {
        let folder = tempfile::tempdir().unwrap();
        let (certificate, key) = certificate(&folder);
        let config = Config {
            certificate: Some(certificate.clone()),
            key: Some(key),
            ..Config::default()
        };
        let broker = Broker::start(&config).unwrap();
        assert!(broker.url().starts_with("mqtts://"), "{}", broker.url());
        let mut roots = RootCertStore::empty();
        roots
            .add(CertificateDer::from_pem_file(&certificate).unwrap())
            .unwrap();
        let mut client = Client::over(secure(&broker, roots), &Hello::default());
        assert_eq!(client.expect(CONNACK)[1], 0);
        client.subscribe("t", 0);
        let blob: Vec<u8> = (0..3_000_000u32)
            .map(|place| ((place * 31) >> 5) as u8)
            .collect();
        client.publish("t", false, &blob);
        assert!(client.hear().3 == blob);
        for number in 0..1000u32 {
            client.publish("t", false, &number.to_be_bytes());
        }
        for number in 0..1000u32 {
            assert_eq!(client.hear().3, number.to_be_bytes());
        }
        // A client that does not trust the certificate, and one without TLS; neither may disturb the others.
        let mut wary = secure(&broker, RootCertStore::empty());
        assert!(std::io::Write::write_all(&mut wary, b"x").is_err());
        let mut plain = Client::new(
            TcpStream::connect(("127.0.0.1", broker.port())).unwrap(),
            true,
        );
        plain.send(&Hello::default().bytes());
        assert_ne!(plain.next().map(|(first, _)| first), Some(CONNACK));
        client.publish("t", false, b"still here");
        assert_eq!(client.hear_payload(), "still here");
    });
}

#[test]
fn a_key_that_does_not_belong_to_the_certificate_is_named() {
    let (one, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (certificate_path, _) = certificate(&one);
    let (_, key) = certificate(&other);
    let config = Config {
        certificate: Some(certificate_path),
        key: Some(key.clone()),
        ..Config::default()
    };
    let message = Broker::start(&config)
        .expect_err("they do not match")
        .to_string();
    assert!(
        message.contains(&key.display().to_string()) && message.contains("does not match"),
        "{message}"
    );
}
