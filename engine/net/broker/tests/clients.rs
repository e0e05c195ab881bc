//! Exchanges with a client library, in MQTT 3.1.1 and 5, with every quality of service.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

use crate::common;

use common::{broker, in_time};
use std::time::Duration;

const MESSAGES: usize = 300;

#[test]
fn mqtt_3_1_1() {
    use rumqttc::{Client, Event, Incoming, LastWill, MqttOptions, QoS};
    in_time(|| {
        let broker = broker();
        let options = |id: &str| {
            let mut options = MqttOptions::new(id, "127.0.0.1", broker.port());
            options.set_keep_alive(Duration::from_secs(5));
            options
        };
        let (reader, mut reading) = Client::new(options("reader"), 1000);
        reader.subscribe("t/+", QoS::ExactlyOnce).unwrap();
        reader.subscribe("gone", QoS::AtLeastOnce).unwrap();
        let mut subscribed = 0;
        for event in reading.iter() {
            subscribed += usize::from(matches!(
                event.unwrap(),
                Event::Incoming(Incoming::SubAck(_))
            ));
            if subscribed == 2 {
                break;
            }
        }
        let mut with_will = options("writer");
        with_will.set_last_will(LastWill::new("gone", "lost", QoS::AtLeastOnce, false));
        let (writer, mut writing) = Client::new(with_will, 1000);
        for number in 0..MESSAGES {
            let qos = [QoS::AtMostOnce, QoS::AtLeastOnce, QoS::ExactlyOnce][number % 3];
            writer
                .publish(format!("t/{}", number % 3), qos, false, number.to_string())
                .unwrap();
        }
        // Wait until the last exchange of QoS 1 and 2 is complete.
        let mut finished = 0;
        for event in writing.iter() {
            finished += usize::from(matches!(
                event.unwrap(),
                Event::Incoming(Incoming::PubAck(_) | Incoming::PubComp(_))
            ));
            if finished == MESSAGES / 3 * 2 {
                break;
            }
        }
        // Leave without DISCONNECT.
        drop((writer, writing));
        let mut seen = vec![Vec::new(); 3];
        for event in reading.iter() {
            let Event::Incoming(Incoming::Publish(message)) = event.unwrap() else {
                continue;
            };
            let text = String::from_utf8(message.payload.to_vec()).unwrap();
            if message.topic == "gone" {
                assert_eq!(text, "lost");
                break;
            }
            let number: usize = text.parse().unwrap();
            assert_eq!(message.qos as usize, number % 3);
            seen[number % 3].push(number);
        }
        for (qos, numbers) in seen.into_iter().enumerate() {
            assert_eq!(
                numbers,
                (0..MESSAGES)
                    .filter(|number| number % 3 == qos)
                    .collect::<Vec<_>>()
            );
        }
    });
}

#[test]
fn mqtt_5() {
    use rumqttc::v5::mqttbytes::QoS;
    use rumqttc::v5::mqttbytes::v5::{Packet, PublishProperties};
    use rumqttc::v5::{Client, Event, MqttOptions};
    in_time(|| {
        let broker = broker();
        let options = |id: &str| {
            let mut options = MqttOptions::new(id, "127.0.0.1", broker.port());
            options.set_keep_alive(Duration::from_secs(5));
            options
        };
        let (server, mut serving) = Client::new(options("server"), 1000);
        server.subscribe("requests", QoS::ExactlyOnce).unwrap();
        for event in serving.iter() {
            if matches!(event.unwrap(), Event::Incoming(Packet::SubAck(_))) {
                break;
            }
        }
        let answering = std::thread::spawn(move || {
            let mut answered = 0;
            for event in serving.iter() {
                let Event::Incoming(Packet::Publish(request)) = event.unwrap() else {
                    continue;
                };
                let asked = request.properties.unwrap();
                assert_eq!(
                    asked.user_properties,
                    [("tool".to_string(), "ada".to_string())]
                );
                assert_eq!(asked.message_expiry_interval, Some(60));
                let answer = PublishProperties {
                    correlation_data: asked.correlation_data,
                    ..Default::default()
                };
                let topic = asked.response_topic.unwrap();
                server
                    .publish_with_properties(
                        topic,
                        QoS::ExactlyOnce,
                        false,
                        request.payload,
                        answer,
                    )
                    .unwrap();
                answered += 1;
                if answered == MESSAGES {
                    server.disconnect().unwrap();
                }
                if answered > MESSAGES {
                    break;
                }
            }
        });
        let (tool, mut asking) = Client::new(options("tool"), 1000);
        tool.subscribe("answers/tool", QoS::ExactlyOnce).unwrap();
        for number in 0..MESSAGES {
            let properties = PublishProperties {
                response_topic: Some("answers/tool".into()),
                correlation_data: Some(number.to_string().into()),
                user_properties: vec![("tool".into(), "ada".into())],
                message_expiry_interval: Some(60),
                ..Default::default()
            };
            let qos = [QoS::AtMostOnce, QoS::AtLeastOnce, QoS::ExactlyOnce][number % 3];
            tool.publish_with_properties(
                "requests",
                qos,
                false,
                format!("payload {number}"),
                properties,
            )
            .unwrap();
        }
        let mut answers = Vec::new();
        for event in asking.iter() {
            let Event::Incoming(Packet::Publish(answer)) = event.unwrap() else {
                continue;
            };
            let number = String::from_utf8(
                answer
                    .properties
                    .unwrap()
                    .correlation_data
                    .unwrap()
                    .to_vec(),
            )
            .unwrap();
            assert_eq!(answer.payload, format!("payload {number}"));
            answers.push(number.parse::<usize>().unwrap());
            if answers.len() == MESSAGES {
                break;
            }
        }
        answers.sort_unstable();
        assert_eq!(answers, (0..MESSAGES).collect::<Vec<_>>());
        drop(answering);
    });
}
