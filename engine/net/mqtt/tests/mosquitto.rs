//! The connection with Mosquitto, in both versions of MQTT.
#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests

use crate::common;

use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use common::{PATIENCE, messages, open, settings, subscription, until};
use swarmwright_mqtt::{
    ConnectError, Connection, Event, PublishOptions, QoS, Subscription, TooLarge, Version, Will,
};

/// A running Mosquitto and the folder of its files.
struct Mosquitto {
    process: Child,
    port: u16,
    _folder: tempfile::TempDir,
}

impl Mosquitto {
    fn start(lines: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let port = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port();
        let configuration = folder.path().join("mosquitto.conf");
        let rules = folder.path().join("access");
        let access = "topic read #\ntopic write allowed/#\n";
        std::fs::write(&rules, access).unwrap();
        let lines = lines.replace("ACCESS", rules.to_str().unwrap());
        // Only root needs the first line; others cannot change the user anyway.
        let lines = format!("user root\nlistener {port} 127.0.0.1\n{lines}\n");
        std::fs::write(&configuration, lines).unwrap();
        let candidates = ["/usr/sbin/mosquitto", "/usr/local/sbin/mosquitto"];
        let binary = candidates.into_iter().find(|path| Path::new(path).exists());
        let process = Command::new(binary.unwrap_or("mosquitto"))
            .arg("-c")
            .arg(configuration)
            .stderr(Stdio::null())
            .spawn()
            .unwrap_or_else(|error| {
                panic!("mosquitto is missing; `make test` installs it: {error}")
            });
        let deadline = Instant::now() + PATIENCE;
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(Instant::now() < deadline, "mosquitto does not listen");
            thread::sleep(Duration::from_millis(10));
        }
        Self {
            process,
            port,
            _folder: folder,
        }
    }

    /// Returns the URLs for both versions of MQTT.
    fn urls(&self) -> [(Version, String); 2] {
        let url = |number| format!("mqtt://127.0.0.1:{}?mqtt={number}", self.port);
        [(Version::Five, url(5)), (Version::Three, url(3))]
    }
}

impl Drop for Mosquitto {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn messages_of_all_kinds_pass() {
    let broker = Mosquitto::start("allow_anonymous true");
    for (version, url) in broker.urls() {
        let mut reader = open(&url, "t/#");
        assert_eq!(reader.version(), Some(version));
        let mut settings = settings(&url);
        settings.will = Some(Will {
            topic: "t/will".into(),
            payload: b"lost".to_vec(),
            expiry: 60,
            retain: false,
        });
        let mut writer = Connection::open(settings, subscription("nothing")).unwrap();
        let mut expected = Vec::new();
        for (number, size) in [0, 1, 127, 128, 16_383, 200_000, 3_000_000]
            .into_iter()
            .enumerate()
        {
            for qos in [QoS::AtMostOnce, QoS::AtLeastOnce] {
                let options = PublishOptions {
                    qos,
                    expiry: Some(60),
                    content_type: Some("application/msgpack"),
                    response_topic: Some("answers/ä"),
                    correlation: Some(&[0, 1, 255]),
                    ..PublishOptions::default()
                };
                let payload = vec![u8::try_from(number).unwrap(); size];
                writer.publish_with("t/x", &payload, &options).unwrap();
                expected.push(("t/x".to_owned(), payload, false));
            }
        }
        let deadline = Instant::now() + PATIENCE;
        let mut events = Vec::new();
        let mut found = Vec::new();
        while found.len() < expected.len() {
            assert!(Instant::now() < deadline, "{} came", found.len());
            let soon = Instant::now() + Duration::from_millis(5);
            writer.poll(soon, &mut events);
            assert!(events.is_empty(), "{events:?}");
            reader.poll(soon, &mut events);
            for event in events.drain(..) {
                match event {
                    Event::Message(it) => {
                        found.push((it.topic().to_owned(), it.payload().to_vec(), it.retained()));
                    }
                    other => panic!("{other:?}"),
                }
            }
        }
        assert!(found == expected);
        drop(writer);
        let will = ("t/will".to_owned(), b"lost".to_vec(), false);
        assert_eq!(messages(&mut reader, 1), [will]);
        // No will is published after an orderly end.
        reader.publish("t/kept", b"", QoS::AtLeastOnce, true, None);
        reader.close(PATIENCE);
    }
}

#[test]
fn what_it_does_not_allow_is_understood() {
    let broker = Mosquitto::start("allow_anonymous true\nacl_file ACCESS\nmax_packet_size 5000");
    for (version, url) in broker.urls() {
        let mut writer = open(&url, "nothing");
        let mut send = |topic: &str| {
            writer.publish_logged(topic, b"", &PublishOptions::CONFIRMED);
        };
        send("allowed/x");
        send("denied");
        if version == Version::Three {
            continue; // MQTT 3.1.1 does not report it.
        }
        until(&mut writer, |event| match event {
            Event::Denied { topic, message } => {
                assert_eq!(topic, "denied");
                assert!(message.contains("(not authorized)"), "{message}");
                true
            }
            _ => false,
        });
        assert_eq!(writer.largest_packet(), 5000);
        let refused = writer.publish_with("allowed/x", &[0; 5000], &PublishOptions::CONFIRMED);
        assert!(matches!(refused, Err(TooLarge { most: 5000, .. })));
        writer.close(PATIENCE);
    }
    let broker = Mosquitto::start("allow_anonymous false");
    for (_, url) in broker.urls() {
        let filters = vec![Subscription {
            filter: "t".into(),
            qos: QoS::AtMostOnce,
        }];
        let error = Connection::open(settings(&url), filters).err().unwrap();
        assert!(matches!(error, ConnectError::Refused { .. }), "{error}");
        assert!(error.to_string().contains("(not authorized)"), "{error}");
    }
}
