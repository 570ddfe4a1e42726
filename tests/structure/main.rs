//! The shape of the core: who imports whom in `src`, held against the floors, and how long files and functions are.

use std::path::{Path, PathBuf};

mod floors;
mod imports;
mod source;

use floors::FLOORS;

/// Most lines of a file, and of a function from its signature to its end.
const FILE_LINES_MAX: usize = 400;
const FUNCTION_LINES_MAX: usize = 60;

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn assert_none(what: &str, faults: &[String]) {
    assert!(faults.is_empty(), "{}\n{} {what}", faults.join("\n"), faults.len());
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let imports = imports::imports(&source::modules(&sources().join("lib.rs")));
    let mut faults = Vec::new();
    for circle in imports::circles(&imports) {
        for file in &circle {
            let others = imports[file].iter().filter(|(other, _)| circle.contains(*other));
            faults.extend(others.map(|(other, names)| {
                format!("{} imports {} for {names:?}", file.display(), other.display())
            }));
        }
    }
    assert_none("imports in circles", &faults);
}

#[test]
fn no_file_imports_from_a_floor_above() {
    let imports = imports::imports(&source::modules(&sources().join("lib.rs")));
    let mut faults = Vec::new();
    for (file, others) in &imports {
        for (other, names) in others.iter().filter(|(other, _)| floor(other) > floor(file)) {
            faults.push(format!("{} imports {} for {names:?}", file.display(), other.display()));
        }
    }
    assert_none("imports from a floor above", &faults);
}

/// The floor on which a file is.
fn floor(file: &Path) -> usize {
    let room = |room: &&str| file.starts_with(room) || file == Path::new(&format!("{room}.rs"));
    let on = |rooms: &&[&str]| rooms.iter().any(room);
    FLOORS.iter().position(on).unwrap_or_else(|| panic!("{} is on no floor", file.display()))
}

#[test]
fn no_file_and_no_function_is_longer_than_a_reader_follows() {
    let mut faults = Vec::new();
    for module in source::modules(&sources().join("lib.rs")).values() {
        let long = module.functions.iter().filter(|(_, lines)| *lines > FUNCTION_LINES_MAX);
        faults
            .extend(long.map(|(name, lines)| format!("{}: {name} has {lines} lines", module.file.display())));
    }
    for file in source::files(&sources()) {
        let lines = std::fs::read_to_string(&file).unwrap().lines().count();
        if lines > FILE_LINES_MAX {
            faults.push(format!("{} has {lines} lines", file.display()));
        }
    }
    assert_none("too long", &faults);
}
