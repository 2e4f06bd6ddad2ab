//! The commands in the page about updates.

use std::fs;
use std::path::Path;

use crate::common::adapter::CanBus;
use crate::common::dfu::{image, tools, update};

const PAGE: &str = include_str!("../../../docs/update.md");

#[test]
fn page_has_the_commands_of_an_update() {
    let bus = CanBus::start();
    let folder = tools("update-page", &bus.boot_loader, 0);
    fs::write(folder.join("armwire-stm32f405.dfu"), image("virtual")).unwrap();
    let output = update(&bus.port(), Path::new("armwire-stm32f405.dfu"), &folder);
    let out = String::from_utf8(output.stdout).unwrap();
    let commands: Vec<_> = out.lines().filter(|line| line.starts_with("dfu-util ")).collect();
    assert_eq!(commands.len(), 2, "{out}");
    for command in commands {
        assert!(PAGE.lines().any(|line| line == format!("$ {command}")), "{command}");
    }
    fs::remove_dir_all(folder).unwrap();
}
