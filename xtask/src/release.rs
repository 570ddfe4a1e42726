//! A release: package, images and updates, their SBOMs and checksums in one folder; and the check that a build gives the same bytes in
//! another folder.

use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::install::{self, Group};
use crate::key::{self, Key, hexadecimal};
use crate::tools::{Outcome, command, fault, output, root, run, written};
use crate::{board, habits, test, update};

/// Endings of what a board's image is flashed from, debugged and updated with; not every board has all.
const ENDINGS: [&str; 4] = ["", "bin", "uf2", update::ENDING];

/// Builds a release into one folder, after checking its crates against the advisory database; fails without that, and without a
/// key. A `rehearsal` goes without the database, into a folder that is called so.
pub(crate) fn build(rehearsal: bool) -> Outcome {
    let key = Key::of_release()?;
    install::check(&[Group::Release, Group::Deny, Group::Package, Group::Thumb])?;
    let mut folder = root().join(concat!("target/release-", env!("CARGO_PKG_VERSION")));
    if rehearsal {
        folder.as_mut_os_string().push("-rehearsal");
    } else {
        habits::cargo_deny(&["advisories"]).map_err(|error| {
            format!("a release needs the RustSec database, and crates without advisories there: {error}")
        })?;
    }
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|error| fault(&folder, &error))?;
    }
    std::fs::create_dir_all(&folder).map_err(|error| fault(&folder, &error))?;
    copy(&test::deb()?, &folder)?;
    for board in boards()? {
        board::run(&board, "build", &[])?;
        for product in products(&board)? {
            copy(&product, &folder)?;
        }
    }
    sboms(&folder)?;
    let sums = checksums(&folder)?;
    written(folder.join("SHA256SUMS"), sums.as_bytes())?;
    print!("{sums}");
    println!("built {}, updates signed for {}", folder.display(), key.public());
    Ok(())
}

/// Builds these boards' images here and in a copy of the checkout elsewhere, all if none are given, and compares them.
pub(crate) fn reproducible(boards: &[String]) -> Outcome {
    let all = self::boards()?;
    let boards = if boards.is_empty() { &all } else { boards };
    // The updates of both are signed by one key.
    let key = std::env::var_os("MOBGATE_SIGNING_KEY").map_or_else(key::development, PathBuf::from);
    let key = std::path::absolute(&key).map_err(|error| fault(&key, &error))?;
    let elsewhere = root().join("target/another folder/of another length");
    copy_checkout(&elsewhere)?;
    for board in boards {
        board::run(board, "build", &[])?;
        let mut cargo = command("cargo", &["xtask", "board", board, "build"]);
        run(cargo.current_dir(&elsewhere).env("MOBGATE_SIGNING_KEY", &key))?;
        for here in products(board)? {
            let there = elsewhere.join(here.strip_prefix(root()).unwrap_or(&here));
            if read(&here)? != read(&there)? {
                return Err(format!("{} and {} differ", here.display(), there.display()));
            }
            println!("the same bytes in another folder: {}", here.display());
        }
    }
    Ok(())
}

/// The boards of a release: those that people have.
fn boards() -> Outcome<Vec<String>> {
    Ok(board::nucleos()?.into_iter().chain(board::RP2040.map(str::to_owned)).collect())
}

/// What the build of a board's image wrote.
fn products(board: &str) -> Outcome<Vec<PathBuf>> {
    let image = board::image(board)?;
    Ok(ENDINGS.map(|ending| image.with_extension(ending)).into_iter().filter(|file| file.exists()).collect())
}

/// Copies the files that git knows, or would add, as they are now.
fn copy_checkout(to: &Path) -> Outcome {
    let list = ["ls-files", "-z", "--cached", "--others", "--exclude-standard", "--deduplicate"];
    let files = output(&mut command("git", &list))?;
    // Those that are deleted, but not yet for git, are not there.
    for file in files.split_terminator('\0').filter(|file| root().join(file).exists()) {
        let copy = to.join(file);
        let folder = copy.parent().unwrap_or(to);
        std::fs::create_dir_all(folder).map_err(|error| fault(folder, &error))?;
        std::fs::copy(root().join(file), &copy).map_err(|error| fault(&copy, &error))?;
    }
    Ok(())
}

/// Writes the SBOMs of the program and of each image, in CycloneDX: of the crates for its processor.
fn sboms(folder: &Path) -> Outcome {
    // cargo-cyclonedx writes one beside the manifest of each package of a workspace.
    let copy = root().join("target/sbom");
    if copy.exists() {
        std::fs::remove_dir_all(&copy).map_err(|error| fault(&copy, &error))?;
    }
    copy_checkout(&copy)?;
    for package in std::iter::once("linux".to_owned()).chain(boards()?) {
        let of = copy.join("boards").join(&package);
        let mut sbom = command("cargo-cyclonedx", &["cyclonedx", "--quiet", "--format", "json"]);
        sbom.args(["--override-filename", "sbom", "--manifest-path"]).arg(of.join("Cargo.toml"));
        if package != "linux" {
            sbom.args(["--target", &board::target(&package)?]);
        }
        run(sbom.envs(date()))?;
        let (from, to) = (of.join("sbom.json"), folder.join(format!("mobgate-{package}.cdx.json")));
        std::fs::rename(from, &to).map_err(|error| fault(&to, &error))?;
    }
    Ok(())
}

/// The variable with the date of all that is built from a commit: when that was made. What was set before holds, as it does where
/// there is no git.
pub(crate) fn date() -> Option<(&'static str, String)> {
    const VARIABLE: &str = "SOURCE_DATE_EPOCH";
    if std::env::var_os(VARIABLE).is_some() {
        return None;
    }
    let seconds = output(&mut command("git", &["log", "-1", "--format=%ct"])).ok()?;
    Some((VARIABLE, seconds.trim().into()))
}

/// The files' checksums, as `sha256sum --check` reads them.
fn checksums(folder: &Path) -> Outcome<String> {
    let entries = folder.read_dir().map_err(|error| fault(folder, &error))?;
    let mut names: Vec<String> =
        entries.flatten().filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    let line =
        |name: &String| Ok(format!("{}  {name}\n", hexadecimal(&Sha256::digest(read(&folder.join(name))?))));
    names.iter().map(line).collect()
}

fn copy(file: &Path, folder: &Path) -> Outcome {
    let mut name = file.file_name().unwrap_or_default().to_owned();
    if file.extension().is_none() {
        name.push(".elf");
    }
    std::fs::copy(file, folder.join(name)).map_err(|error| fault(file, &error))?;
    Ok(())
}

fn read(file: &Path) -> Outcome<Vec<u8>> {
    std::fs::read(file).map_err(|error| fault(file, &error))
}

#[cfg(test)]
mod tests {
    use super::checksums;

    #[test]
    fn checksums_are_those_of_sha256sum() {
        let folder = std::env::temp_dir().join(format!("mobgate-sums-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("b.bin"), "abc").unwrap();
        std::fs::write(folder.join("a.bin"), "").unwrap();
        let sums = checksums(&folder).unwrap();
        std::fs::write(folder.join("SHA256SUMS"), &sums).unwrap();
        let names: Vec<&str> = sums.lines().map(|line| &line[66..]).collect();
        assert_eq!(names, ["a.bin", "b.bin"]);
        let mut check = crate::tools::command("sha256sum", &["--check", "--quiet", "SHA256SUMS"]);
        assert!(check.current_dir(&folder).status().unwrap().success());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
