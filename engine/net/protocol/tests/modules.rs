//! Selection of servers that have the Python behaviours and conditions of a machine.

use swarmwright_protocol::{ModuleCode, missing_module};

fn code(role: &str, name: &str, sha256: Option<&str>) -> ModuleCode {
    ModuleCode {
        role: role.to_owned(),
        name: name.to_owned(),
        file: sha256.map(|_| "parts.py".to_owned()),
        sha256: sha256.map(str::to_owned),
    }
}

#[test]
fn every_module_must_be_there_with_its_code() {
    let spiral = code("behaviour", "Spiral", Some("aa11"));
    let elapsed = code("condition", "Elapsed", Some("bb22"));
    let needed = [spiral.clone(), elapsed.clone()];
    assert_eq!(missing_module(&needed, &needed), None);
    assert_eq!(missing_module(&needed, &[]), None);
    assert_eq!(
        missing_module(&[spiral], &needed).as_deref(),
        Some("has no condition 'parts.py:Elapsed'; start it with --modules parts.py:Elapsed")
    );
    // A condition is not a behaviour, whatever its name.
    let other = code("condition", "Spiral", Some("aa11"));
    assert!(missing_module(&[other, elapsed], &needed).is_some());
}

#[test]
fn of_two_with_one_name_the_code_counts() {
    let needed = [code("behaviour", "Spiral", Some("aa11"))];
    let old = code("behaviour", "Spiral", Some("0123456789abcdef0123"));
    assert_eq!(
        missing_module(&[old.clone(), needed[0].clone()], &needed),
        None
    );
    let reason = missing_module(&[old], &needed).unwrap_or_default();
    let expected = "has different code for behaviour 'parts.py:Spiral' (SHA-256 0123456789abcdef.., expected aa11..); ";
    assert!(reason.starts_with(expected), "{reason}");
}

#[test]
fn where_the_code_is_not_known_the_name_counts() {
    let needed = [code("behaviour", "spiral", None)];
    assert_eq!(
        missing_module(&[code("behaviour", "spiral", Some("aa"))], &needed),
        None
    );
    assert!(
        missing_module(
            &[code("behaviour", "spiral", None)],
            &[code("behaviour", "spiral", Some("aa"))]
        )
        .is_some()
    );
}
