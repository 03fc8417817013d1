//! The outer shell of a glTF file: a binary container with chunks, or bare JSON.
//!
//! The container is split here and not by the `gltf` crate, whose splitter underflows on a header
//! length below twelve and refuses chunks it does not know, which glTF says to skip.

use crate::SceneError;

/// The two parts of a file.
#[derive(Debug)]
pub(crate) struct Container<'a> {
    /// glTF JSON.
    pub(crate) json: &'a [u8],
    /// The binary chunk, which is buffer 0.
    pub(crate) binary: Option<&'a [u8]>,
}

const MAGIC: &[u8] = b"glTF";
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;
const JSON_CHUNK: u32 = u32::from_le_bytes(*b"JSON");
const BINARY_CHUNK: u32 = u32::from_le_bytes(*b"BIN\0");

/// Finds the JSON and the binary chunk in `bytes`.
///
/// # Errors
/// [`SceneError::NotGltf`] and [`SceneError::Truncated`].
pub(crate) fn split<'a>(file: &str, bytes: &'a [u8]) -> Result<Container<'a>, SceneError> {
    let not_gltf = |cause: &str| SceneError::NotGltf { file: file.to_owned(), cause: cause.to_owned() };
    if bytes.is_empty() {
        return Err(not_gltf("the file is empty"));
    }
    if bytes.starts_with(MAGIC) || MAGIC.starts_with(bytes) {
        return split_binary(file, bytes);
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match text.iter().find(|byte| !byte.is_ascii_whitespace()) {
        Some(b'{') => Ok(Container { json: text, binary: None }),
        _ => Err(not_gltf("it starts neither with `glTF` nor with `{`")),
    }
}

fn split_binary<'a>(file: &str, bytes: &'a [u8]) -> Result<Container<'a>, SceneError> {
    let not_gltf = |cause: String| SceneError::NotGltf { file: file.to_owned(), cause };
    let truncated = |cause: String| SceneError::Truncated { file: file.to_owned(), cause };
    let (Some(version), Some(length)) = (word(bytes, 4), word(bytes, 8)) else {
        return Err(truncated(format!("the header has {} of {HEADER_BYTES} bytes", bytes.len())));
    };
    if version != 2 {
        return Err(not_gltf(format!("the container has version {version}")));
    }
    let length = length as usize;
    if length > bytes.len() {
        return Err(truncated(format!("{} of {length} bytes are there", bytes.len())));
    }
    let bytes = &bytes[..length];
    let mut container = Container { json: &[], binary: None };
    let mut offset = HEADER_BYTES;
    let mut position = 0;
    while offset < length {
        let (Some(size), Some(kind)) = (word(bytes, offset), word(bytes, offset + 4)) else {
            return Err(truncated(format!("the header of chunk {position} is cut")));
        };
        let start = offset + CHUNK_HEADER_BYTES;
        let end = start + size as usize;
        let Some(chunk) = bytes.get(start..end) else {
            return Err(truncated(format!("chunk {position} ends at byte {end} of {length}")));
        };
        match (position, kind) {
            (0, JSON_CHUNK) => container.json = chunk,
            (0, _) => return Err(not_gltf("the first chunk is not JSON".to_owned())),
            (1, BINARY_CHUNK) => container.binary = Some(chunk),
            _ => {}
        }
        offset = end;
        position += 1;
    }
    if position == 0 {
        return Err(not_gltf("the container has no chunks".to_owned()));
    }
    Ok(container)
}

fn word(bytes: &[u8], offset: usize) -> Option<u32> {
    let four = bytes.get(offset..offset.checked_add(4)?)?;
    Some(u32::from_le_bytes(four.try_into().ok()?))
}
