//! The build script of a board with a boot loader: the program and the boot loader are linked to different parts of the flash. The boot loader's
//! name is the program's with `-boot` behind it.

fn main() {
    let name = std::env::var("CARGO_PKG_NAME").unwrap_or_default();
    for (binary, folder) in [(name.clone(), "program"), (name + "-boot", "loader")] {
        println!("cargo::rustc-link-arg-bin={binary}=-L../boot/link/{folder}");
        println!("cargo::rustc-link-arg-bin={binary}=-L../boot/link");
    }
    println!("cargo::rerun-if-changed=regions.x");
    println!("cargo::rerun-if-changed=../boot/link");
}
