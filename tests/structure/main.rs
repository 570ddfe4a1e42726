//! The shape of the core: who imports whom in `src`, held against the floors, and how long files and functions are.

use std::path::Path;

mod imports;
mod source;

fn root() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let imports = imports::imports(&source::modules(&root()));
    let circles = imports::circles(&imports);
    for circle in &circles {
        println!("a circle of {} files:", circle.len());
        for file in circle {
            for (other, names) in imports[file].iter().filter(|(other, _)| circle.contains(*other)) {
                println!("  {} imports {} for {names:?}", file.display(), other.display());
            }
        }
    }
    assert!(circles.is_empty(), "{} circles of files", circles.len());
}

#[test]
fn functions() {
    let modules = source::modules(&root());
    let mut long: Vec<_> = modules
        .values()
        .flat_map(|m| m.functions.iter().map(move |(n, l)| (*l, n, &m.file)))
        .filter(|(l, ..)| *l > 60)
        .collect();
    long.sort();
    println!("{long:#?}");
    assert!(long.is_empty());
}

/// Floors, from the lowest up: a file imports from its own floor and from those below.
const FLOORS: &[&[&str]] = &[
    &["fmt.rs", "modbus"],
    &["scanner", "settings", "routing", "language"],
    &["hal.rs", "frame", "stats", "capture", "gateway"],
    &["port"],
    &["console"],
    &["tasks"],
];

#[test]
fn no_file_imports_from_a_floor_above() {
    let imports = imports::imports(&source::modules(&root()));
    let floor = |file: &Path| {
        let room = file.components().next().unwrap().as_os_str().to_str().unwrap();
        let room = room.strip_suffix(".rs").unwrap_or(room);
        FLOORS.iter().position(|rooms| rooms.iter().any(|r| r.strip_suffix(".rs").unwrap_or(r) == room))
    };
    let mut bad = 0;
    for (file, others) in &imports {
        for (other, names) in others {
            if floor(other) > floor(file) {
                println!(
                    "{} {:?} imports {} {:?} for {names:?}",
                    file.display(),
                    floor(file),
                    other.display(),
                    floor(other)
                );
                bad += 1;
            }
        }
    }
    assert_eq!(bad, 0);
}
