//! The bytes of every message, so that an old client still reads a new server.
//!
//! Goal: no change of the schema alters bytes that are in the field. Method: each message, every field filled,
//! is encoded and held against `golden/messages.txt`, and the golden bytes decode to the same message.
//! `BLESS=1` rewrites the file: only for new messages and new fields.

mod samples;

use prost::Message as _;
use samples::Sample;
use std::{collections::BTreeMap, path::PathBuf};

fn golden_path() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden/messages.txt")
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unhex(text: &str) -> Vec<u8> {
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).expect("hex")).collect()
}

#[test]
fn every_message_keeps_its_bytes() {
    let samples = samples::all();
    if std::env::var_os("BLESS").is_some() {
        let lines: String = samples.iter().map(|s| format!("{} {}\n", s.name(), hex(&s.encode()))).collect();
        std::fs::create_dir_all(golden_path().parent().unwrap()).unwrap();
        std::fs::write(golden_path(), lines).unwrap();
    }
    let golden = std::fs::read_to_string(golden_path()).expect("golden/messages.txt; BLESS=1 writes it");
    let golden: BTreeMap<&str, &str> = golden.lines().filter_map(|line| line.split_once(' ')).collect();
    assert_eq!(golden.len(), samples.len(), "one line a message");
    for sample in &samples {
        let name = sample.name();
        let expected = golden.get(name).unwrap_or_else(|| panic!("no golden bytes of {name}"));
        assert_eq!(&hex(&sample.encode()), expected, "the bytes of {name} changed");
        assert!(sample.is_decoded_from(&unhex(expected)), "{name} is read back differently");
    }
}

#[test]
fn fields_of_the_future_are_ignored() {
    for sample in samples::all() {
        let mut bytes = sample.encode();
        // Field 1000, varint 7: nobody has it yet.
        prost::encoding::uint32::encode(1000, &7, &mut bytes);
        assert!(sample.is_decoded_from(&bytes), "{}", sample.name());
    }
}

#[test]
fn truncated_messages_are_errors_or_shorter_but_never_panics() {
    for sample in samples::all() {
        let bytes = sample.encode();
        for length in 0..bytes.len() {
            assert!(!sample.is_decoded_from(&bytes[..length]), "{} cut at {length}", sample.name());
        }
    }
}

#[test]
fn the_descriptor_set_names_the_service() {
    let set = prost_types::FileDescriptorSet::decode(earthshine_protocol::FILE_DESCRIPTOR_SET).unwrap();
    let file = set.file.iter().find(|file| file.package() == "earthshine.v1").expect("our package");
    assert_eq!(file.service[0].name(), "Lighting");
    let sampled: Vec<&str> = samples::all().iter().map(Sample::message).collect();
    for message in &file.message_type {
        assert!(sampled.contains(&message.name()), "no golden bytes of message {}", message.name());
    }
}
