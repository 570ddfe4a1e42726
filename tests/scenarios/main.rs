//! Behaviour as data: every case of every `*.yaml` file beside this one is a test.
//!
//! A case is played in a world of its own, in virtual time. `file` reads what is connected to the gateway, `script` puts
//! its steps in order, and `play` does what they say. README.md tells the language.

use std::path::{Path, PathBuf};

use libtest_mimic::{Arguments, Failed, Trial};

mod faults;
mod file;
mod play;
mod script;
mod words;

fn main() {
    let arguments = Arguments::from_args();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenarios");
    let trials = files(&folder).iter().flat_map(|path| trials(path)).collect();
    libtest_mimic::run(&arguments, trials).exit();
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = folder.read_dir().expect("the folder of the scenarios");
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("an entry of the folder").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "yaml"))
        .collect();
    files.sort();
    files
}

/// One test for each case; a file that cannot be read is one failing test.
fn trials(path: &Path) -> Vec<Trial> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let text = std::fs::read_to_string(path).expect("a file that was listed just now");
    match file::cases(&text) {
        Ok(cases) => cases.into_iter().map(|case| trial(&stem, case)).collect(),
        Err(error) => {
            let error = Failed::from(error.to_string());
            vec![Trial::test(format!("{stem} can be read"), move || Err(error))]
        }
    }
}

fn trial(stem: &str, case: file::Case) -> Trial {
    Trial::test(format!("{stem}: {}", case.name), move || play::play(&case).map_err(Failed::from))
}
