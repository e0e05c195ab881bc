//! Import order of the scheduler's parts, which must not know the scheduler; `engine/cycles.py` checks for cycles.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Modules with private state that the scheduler owns. Each may import only the ones before it.
const PARTS: [&str; 14] = [
    "scheduler::job",
    "scheduler::outbox",
    "scheduler::queue",
    "scheduler::modes",
    "scheduler::fleet",
    "scheduler::limits",
    "scheduler::audit",
    "scheduler::messages",
    "scheduler::outlook",
    "scheduler::recheck",
    "scheduler::view",
    "scheduler::share",
    "scheduler::speculation",
    "scheduler::probing",
];
/// Imported modules, by module.
type Imports = BTreeMap<String, BTreeSet<String>>;

fn sources(folder: &Path, module: &str, files: &mut BTreeMap<String, String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let inner = |name: &str| match module {
            "" => name.to_owned(),
            _ => format!("{module}::{name}"),
        };
        match (&*stem, path.is_dir()) {
            (_, true) => sources(&path, &inner(&stem), files),
            ("lib" | "tests", false) => {}
            ("mod", false) => {
                files.insert(module.to_owned(), std::fs::read_to_string(path).unwrap());
            }
            (_, false) => {
                files.insert(inner(&stem), std::fs::read_to_string(path).unwrap());
            }
        }
    }
}

/// Returns the module at the start of a path such as `crate::config::Config` or `super::Ledger`, if it is in `sources`.
fn resolved(path: &str, module: &str, sources: &BTreeMap<String, String>) -> Option<String> {
    let parent = module.rsplit_once("::").map_or("", |(parent, _)| parent);
    let mut path = match path.split_once("::")? {
        ("crate", rest) => rest.to_owned(),
        ("super", rest) => format!("{parent}::{rest}"),
        (_, _) => format!("{module}::{path}"),
    };
    loop {
        if sources.contains_key(&path) {
            return Some(path).filter(|name| name != module);
        }
        path = path.rsplit_once("::")?.0.to_owned();
    }
}

fn imports() -> Imports {
    let mut files = BTreeMap::new();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    sources(&folder, "", &mut files);
    let of = |(module, text): (&String, &String)| {
        let text = text.split("#[cfg(test)]").next().unwrap();
        let statements = text.split("\nuse ").skip(1);
        let paths = statements.map(|rest| {
            let path = rest.split(';').next().unwrap();
            let (path, names) = path.split_once("::{").unwrap_or((path, ""));
            let plain = path != "crate" && !names.contains("::") && !names.contains("self");
            assert!(
                plain,
                "{module}: give each module a line: {path}::{{{names}"
            );
            format!("{path}::_")
        });
        let imports = paths.filter_map(|path| resolved(&path, module, &files));
        (module.clone(), imports.collect())
    };
    files.iter().map(of).collect()
}

#[test]
fn parts_import_those_before_them_only() {
    let imports = imports();
    assert!(imports.len() > 50, "{imports:?}");
    assert!(imports["scheduler"].contains("scheduler::fleet"));
    assert!(imports["shell::pool"].contains("scheduler"));
    let part = |module: &str| {
        let is_in = |part: &&str| module == *part || module.starts_with(&format!("{part}::"));
        PARTS.iter().position(is_in)
    };
    for (module, imported) in &imports {
        let Some(place) = part(module) else {
            continue;
        };
        for other in imported {
            let in_scheduler = other == "scheduler" || other.starts_with("scheduler::");
            let allowed = !in_scheduler || part(other).is_some_and(|other| other <= place);
            assert!(
                allowed && !other.starts_with("shell"),
                "{module} imports {other}"
            );
        }
    }
}
