//! The shape of the sources: who imports whom, in the core held against the floors, and how long files and functions are in the whole
//! repository.

use std::path::{Path, PathBuf};

mod floors;
mod imports;
mod source;

use floors::FLOORS;

/// Most lines of a file other than tests, and of any function from its signature to its end.
const FILE_LINES_MAX: usize = 400;
const FUNCTION_LINES_MAX: usize = 60;
/// Most lines of a board's `main.rs`: what boards share is in libraries.
const BOARD_LINES_MAX: usize = 99;

/// The first files of the crates in which no files import each other in a circle, the core's in front.
const CRATES: &[&str] = &[
    "src/lib.rs",
    "ethercat/description/src/lib.rs",
    "ethercat/emulator/src/lib.rs",
    "ethercat/subdevice/src/lib.rs",
    "boards/boot/src/lib.rs",
    "boards/boot_cortex_m/src/lib.rs",
    "boards/common/src/lib.rs",
    "boards/description/src/lib.rs",
    "boards/firmware/src/lib.rs",
    "boards/flash/src/lib.rs",
    "boards/image/src/lib.rs",
    "boards/linux/src/lib.rs",
    "boards/mdns/src/lib.rs",
    "boards/net/src/lib.rs",
    "boards/qemu_mps2/src/main.rs",
    "boards/rp/src/lib.rs",
    "boards/rp_boot/src/lib.rs",
    "boards/ssh/src/lib.rs",
    "boards/stm32/src/lib.rs",
    "boards/stm32_boot/src/lib.rs",
    "boards/update/src/lib.rs",
    "tests/simulator/src/lib.rs",
];

fn first_file(of_crate: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(of_crate)
}

fn assert_none(what: &str, faults: &[String]) {
    assert!(faults.is_empty(), "{}\n{} {what}", faults.join("\n"), faults.len());
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let mut faults = Vec::new();
    for of_crate in CRATES {
        let imports = imports::imports(&source::modules(&first_file(of_crate)));
        for circle in imports::circles(&imports) {
            for file in &circle {
                let others = imports[file].iter().filter(|(other, _)| circle.contains(*other));
                faults.extend(others.map(|(other, names)| {
                    format!("{of_crate}: {} imports {} for {names:?}", file.display(), other.display())
                }));
            }
        }
    }
    assert_none("imports in circles", &faults);
}

#[test]
fn no_file_imports_from_a_floor_above() {
    let imports = imports::imports(&source::modules(&first_file(CRATES[0])));
    let mut faults = Vec::new();
    for (file, others) in &imports {
        for (other, names) in others.iter().filter(|(other, _)| floor(other) > floor(file)) {
            faults.push(format!("{} imports {} for {names:?}", file.display(), other.display()));
        }
    }
    assert_none("imports from a floor above", &faults);
}

fn floor(file: &Path) -> usize {
    let room = |room: &&str| file.starts_with(room) || file == Path::new(&format!("{room}.rs"));
    let on = |rooms: &&[&str]| rooms.iter().any(room);
    FLOORS.iter().position(on).unwrap_or_else(|| panic!("{} is on no floor", file.display()))
}

#[test]
fn no_file_and_no_function_is_longer_than_a_reader_follows() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = source::files(root);
    assert!(files.len() > 900, "of the whole repository");
    let mut faults = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        let file = file.strip_prefix(root).unwrap();
        let lines = text.lines().count();
        if lines > FILE_LINES_MAX && !is_test(file) {
            faults.push(format!("{} has {lines} lines", file.display()));
        }
        let functions = source::functions(&text).into_iter();
        let long = functions.filter(|(_, lines)| *lines > FUNCTION_LINES_MAX);
        faults.extend(long.map(|(name, lines)| format!("{}: {name} has {lines} lines", file.display())));
    }
    assert_none("too long", &faults);
}

/// Whether a file is of the tests beside a crate's sources; a long one of these lists many cases of one thing.
fn is_test(file: &Path) -> bool {
    let room = file.iter().find(|folder| *folder == "src" || *folder == "tests");
    room.is_some_and(|room| room == "tests")
}

#[test]
fn no_main_of_a_board_is_longer_than_its_own_things() {
    let boards = Path::new(env!("CARGO_MANIFEST_DIR")).join("boards");
    let folders: Vec<PathBuf> = boards.read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
    // The others have no memory of their own: libraries, and the Linux program.
    let boards: Vec<_> = folders.iter().filter(|folder| folder.join("regions.x").exists()).collect();
    let lines = |board: &Path| std::fs::read_to_string(board.join("src/main.rs")).unwrap().lines().count();
    let counted = boards.iter().map(|board| (board.display(), lines(board)));
    let long = counted.filter(|(_, lines)| *lines > BOARD_LINES_MAX);
    let faults: Vec<String> =
        long.map(|(board, lines)| format!("{board}: main.rs has {lines} lines")).collect();
    assert!(boards.len() > 4, "{boards:?}");
    assert_none("too long", &faults);
}
