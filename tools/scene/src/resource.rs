//! Bytes that a glTF file names by URI: data URIs and files beside it. No network, no absolute paths.

use std::io::Read;
use std::path::Path;

/// Most bytes of one file that are read into memory.
pub(crate) const FILE_BYTES_MAX: u64 = 8 << 30;

/// Longest URI shown in a message.
const URI_SHOWN_MAX: usize = 80;

/// Reads `path` whole.
///
/// # Errors
/// As [`read_file_up_to`] [`FILE_BYTES_MAX`].
pub(crate) fn read_file(path: &Path) -> std::io::Result<Vec<u8>> {
    read_file_up_to(path, FILE_BYTES_MAX)
}

/// Reads `path` whole, if it has at most `bytes_max` bytes.
///
/// # Errors
/// What the operating system says; [`std::io::ErrorKind::FileTooLarge`] beyond the limit.
pub(crate) fn read_file_up_to(path: &Path, bytes_max: u64) -> std::io::Result<Vec<u8>> {
    let file = std::fs::File::open(path)?;
    let expected = file.metadata().map_or(0, |metadata| metadata.len());
    let mut bytes = Vec::with_capacity(usize::try_from(expected.min(bytes_max)).unwrap_or(0));
    file.take(bytes_max + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > bytes_max {
        let cause = format!("it has more than the {bytes_max} bytes that are read");
        return Err(std::io::Error::new(std::io::ErrorKind::FileTooLarge, cause));
    }
    Ok(bytes)
}

/// The bytes that `uri` stands for; files are looked up in `folder`.
///
/// # Errors
/// Why not, for a message.
pub(crate) fn fetch(uri: &str, folder: Option<&Path>) -> Result<Vec<u8>, String> {
    if uri.starts_with("data:") {
        // The gltf crate decodes base64; of the other schemes it would panic on a bad escape.
        return gltf::buffer::Data::from_source(gltf::buffer::Source::Uri(uri), None)
            .map(|data| data.0)
            .map_err(|error| format!("the data URI cannot be decoded: {error}"));
    }
    if uri.contains(':') || uri.starts_with(['/', '\\']) {
        return Err("only data URIs and paths relative to the file are read".to_owned());
    }
    let Some(folder) = folder else {
        return Err("the scene was loaded from memory, so there is no folder to look in".to_owned());
    };
    let decoded = percent_decoded(uri).ok_or("its percent escapes are not UTF-8")?;
    match read_file(&folder.join(&decoded)) {
        // Some exporters write names unescaped.
        Err(error) if error.kind() == std::io::ErrorKind::NotFound && decoded != uri => {
            read_file(&folder.join(uri)).map_err(|error| error.to_string())
        }
        other => other.map_err(|error| error.to_string()),
    }
}

/// `uri`, short enough for a message.
pub(crate) fn shown(uri: &str) -> String {
    if uri.len() <= URI_SHOWN_MAX {
        return uri.to_owned();
    }
    let head: String = uri.chars().take(URI_SHOWN_MAX / 2).collect();
    format!("{head}... ({} characters)", uri.len())
}

fn percent_decoded(uri: &str) -> Option<String> {
    let mut decoded = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let escape = tail.get(..2).filter(|_| *first == b'%');
        let value = escape
            .and_then(|digits| std::str::from_utf8(digits).ok())
            .filter(|digits| digits.bytes().all(|digit| digit.is_ascii_hexdigit()))
            .and_then(|digits| u8::from_str_radix(digits, 16).ok());
        decoded.push(value.unwrap_or(*first));
        rest = if value.is_some() { &tail[2..] } else { tail };
    }
    String::from_utf8(decoded).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_are_decoded_and_stray_percent_signs_kept() {
        assert_eq!(percent_decoded("a%20b%2Fc").as_deref(), Some("a b/c"));
        assert_eq!(percent_decoded("100%").as_deref(), Some("100%"));
        assert_eq!(percent_decoded("%+1%zz").as_deref(), Some("%+1%zz"));
        assert_eq!(percent_decoded("%ff"), None);
    }

    #[test]
    fn other_places_are_not_read() {
        for uri in ["http://example.org/a.bin", "file:///etc/passwd", "/etc/passwd", "C:\\a.bin"] {
            assert!(fetch(uri, Some(Path::new("."))).is_err(), "{uri}");
        }
    }
}
