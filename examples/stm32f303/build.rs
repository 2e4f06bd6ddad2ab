//! Tells the linker which scripts place the program in memory. That of the chip's memory is embassy-stm32's.

fn main() {
    for option in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={option}");
    }
}
