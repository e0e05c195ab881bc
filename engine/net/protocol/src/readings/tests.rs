//! Tests of sensor, actuator and fitness messages.

use proptest::prelude::*;

use super::*;

proptest! {
    #[test]
    fn readings_survive_the_wire_to_the_bit(bits in prop::collection::vec(any::<u32>(), 1..20), agent in 0u64..1 << 63) {
        let sensor: Vec<f32> = bits.into_iter().map(f32::from_bits).filter(|x| x.is_finite()).collect();
        prop_assume!(!sensor.is_empty());
        let sent = Sensor { simulation: Some("a\"\u{1f41d}".into()), simulation_hash: "00".into(), agent, sensor };
        let read = Sensor::decode(&sent.encode()).unwrap();
        prop_assert_eq!(sent.agent, read.agent);
        let to_bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(to_bits(&sent.sensor), to_bits(&read.sensor));
    }

    #[test]
    fn fitness_survives_the_wire_to_the_bit(bits in any::<u64>()) {
        let fitness = f64::from_bits(bits);
        prop_assume!(fitness.is_finite());
        let metrics = BTreeMap::from([("a b\"\u{1f41d}".to_owned(), fitness)]);
        let sent = Fitness { simulation: None, simulation_hash: "00".into(), fitness, metrics };
        let read = Fitness::decode(&sent.encode()).unwrap();
        prop_assert_eq!(read.fitness.to_bits(), bits);
        prop_assert_eq!(read.metrics.into_values().map(f64::to_bits).collect::<Vec<_>>(), [bits]);
    }

    #[test]
    fn junk_is_refused_and_never_panics(junk in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = (Sensor::decode(&junk), Actuator::decode(&junk), Fitness::decode(&junk));
    }
}

proptest! {
    #[test]
    fn an_episode_s_writer_writes_what_the_messages_write(
        title in ".{0,8}", hash in ".{0,8}", agent in 0u64..1 << 63, bits in prop::collection::vec(any::<u32>(), 1..20),
    ) {
        let numbers: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
        let sensor = Sensor {
            simulation: Some(title.clone()), simulation_hash: hash.clone(), agent, sensor: numbers.clone(),
        };
        prop_assert_eq!(ReadingWriter::sensor(&title, &hash).encode(agent, &numbers), sensor.encode());
        let actuator = Actuator {
            simulation: Some(title.clone()), simulation_hash: hash.clone(), agent, actuator: numbers.clone(),
        };
        prop_assert_eq!(ReadingWriter::actuator(&title, &hash).encode(agent, &numbers), actuator.encode());
    }

    #[test]
    fn a_borrowed_reading_is_the_message(title in ".{0,8}", hash in ".{0,8}", agent in 0u64..1 << 63, number in -9f32..9.0) {
        let sensor = Sensor { simulation: Some(title), simulation_hash: hash, agent, sensor: vec![number] };
        let payload = sensor.encode();
        let read = SensorReading::decode(&payload).unwrap();
        prop_assert_eq!(&read.simulation_hash, &sensor.simulation_hash);
        prop_assert_eq!((read.agent, read.sensor), (sensor.agent, sensor.sensor));
    }
}

#[test]
fn decimals_become_the_nearest_binary32_not_the_nearest_of_the_nearest_binary64() {
    // If rounded to binary64 first, this decimal is halfway between two binary32 numbers and is then rounded in the
    // wrong direction.
    let text = br#"{"simulation_hash":"0","agent":0,"actuator":[1.00000017881393432617187499999]}"#;
    assert_eq!(
        Actuator::decode(text).unwrap().actuator[0].to_bits(),
        0x3f80_0001
    );
}

#[test]
fn of_metrics_what_is_a_finite_number_is_read_and_nothing_is_an_error() {
    for (text, expected) in [
        (
            r#"{"a":1,"b":-2.5e3,"c":null,"d":"1","e":1e999,"f":[1],"g":true}"#,
            vec![("a", 1.0), ("b", -2500.0)],
        ),
        (r#"{"a":1,"a":2}"#, vec![("a", 2.0)]),
        (r#"{"\u0061":1}"#, vec![("a", 1.0)]),
        ("[1, 2]", vec![]),
        ("\"none\"", vec![]),
        ("{}", vec![]),
    ] {
        let text = format!(r#"{{"simulation_hash":"0","metrics":{text},"fitness":1}}"#);
        let read = Fitness::decode(text.as_bytes()).unwrap().metrics;
        let expected = expected
            .into_iter()
            .map(|(name, value)| (name.to_owned(), value));
        assert_eq!(read, expected.collect(), "{text}");
    }
    assert!(Fitness::decode(br#"{"simulation_hash":"0","metrics":{,"fitness":1}"#).is_err());
}

#[test]
fn numbers_beyond_binary32_are_refused() {
    let text = br#"{"simulation_hash":"0","agent":0,"actuator":[1e39]}"#;
    assert!(Actuator::decode(text).is_err());
}

#[test]
fn what_an_agent_sees_may_be_large_and_nothing_else() {
    let sensor = vec![0.123_456_79; 200_000];
    let payload = ReadingWriter::sensor("eye", "0").encode(0, &sensor);
    assert!(payload.len() > 2 * MAX_PAYLOAD);
    assert_eq!(SensorReading::decode(&payload).unwrap().sensor, sensor);
    let payload = ReadingWriter::actuator("eye", "0").encode(0, &sensor);
    let (bytes, most) = (payload.len(), MAX_PAYLOAD);
    let refused = DecodeError::TooLarge { bytes, most };
    assert_eq!(Actuator::decode(&payload), Err(refused));
    let bytes = MAX_SENSOR + 1;
    let most = MAX_SENSOR;
    let refused = DecodeError::TooLarge { bytes, most };
    assert_eq!(Sensor::decode(&vec![b' '; bytes]), Err(refused));
}
