//! Passes the layout scripts to the linker. embassy-stm32 provides the chip's memory map.

fn main() {
    for option in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={option}");
    }
}
