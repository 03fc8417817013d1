//! One glTF file opened: its JSON, its buffers, and the errors that name it. Geometry is read elsewhere.
//!
//! Nothing of the `gltf` crate's own validation is relied on: every reference is looked up with a check.

use crate::{SceneError, container, extensions, resource};
use gltf::json;
use std::borrow::Cow;
use std::path::Path;

/// A file, its JSON tree and its bytes.
#[derive(Debug)]
pub(crate) struct Document<'a> {
    /// For messages.
    pub(crate) file: &'a str,
    /// Where relative URIs start; `None` for a scene in memory.
    pub(crate) folder: Option<&'a Path>,
    /// The whole tree.
    pub(crate) root: json::Root,
    /// One a buffer of the tree.
    buffers: Vec<Cow<'a, [u8]>>,
    /// A sentence for each extension that is ignored.
    pub(crate) ignored_extensions: Vec<String>,
}

/// Read before the tree, so that version and extensions are judged before details of their contents.
#[derive(serde::Deserialize)]
struct Head {
    asset: Asset,
    #[serde(flatten)]
    extensions: extensions::Declared,
}

#[derive(serde::Deserialize)]
struct Asset {
    version: String,
}

impl<'a> Document<'a> {
    /// Parses `bytes` and fetches the buffers.
    ///
    /// # Errors
    /// Everything that is wrong with the file as a file.
    pub(crate) fn open(file: &'a str, folder: Option<&'a Path>, bytes: &'a [u8]) -> Result<Self, SceneError> {
        let container = container::split(file, bytes)?;
        let head: Head = parse(file, container.json)?;
        if !head.asset.version.starts_with("2.") {
            let cause = format!("its asset version is `{}`", head.asset.version);
            return Err(SceneError::NotGltf { file: file.to_owned(), cause });
        }
        let ignored_extensions = extensions::check(file, &head.extensions)?;
        let root = parse(file, container.json)?;
        let mut document = Self { file, folder, root, buffers: Vec::new(), ignored_extensions };
        document.buffers = document.fetch_buffers(container.binary)?;
        Ok(document)
    }

    fn fetch_buffers(&self, binary: Option<&'a [u8]>) -> Result<Vec<Cow<'a, [u8]>>, SceneError> {
        let mut total = 0;
        let mut buffers = Vec::with_capacity(self.root.buffers.len());
        for (index, buffer) in self.root.buffers.iter().enumerate() {
            let expected = buffer.byte_length.0;
            let missing = |uri: String, cause: String| SceneError::MissingBuffer {
                file: self.file.to_owned(),
                uri,
                cause,
            };
            let bytes = match (&buffer.uri, binary) {
                (Some(uri), _) => {
                    let bytes = resource::fetch(uri, self.folder)
                        .map_err(|cause| missing(resource::shown(uri), cause))?;
                    total += bytes.len() as u64;
                    Cow::Owned(bytes)
                }
                (None, Some(chunk)) if index == 0 => Cow::Borrowed(chunk),
                (None, _) => {
                    let cause = "it has no address and the file no binary chunk for it".to_owned();
                    return Err(missing(index.to_string(), cause));
                }
            };
            if (bytes.len() as u64) < expected {
                let cause = format!("buffer {index} has {} of {expected} bytes", bytes.len());
                return Err(SceneError::Truncated { file: self.file.to_owned(), cause });
            }
            if total > resource::FILE_BYTES_MAX {
                return Err(self.limit("bytes of buffers", total, resource::FILE_BYTES_MAX));
            }
            buffers.push(bytes);
        }
        Ok(buffers)
    }

    /// The bytes of a buffer view and its stride.
    ///
    /// # Errors
    /// Why there are none, for a message.
    pub(crate) fn view(&self, index: usize) -> Result<(&[u8], Option<usize>), String> {
        let wrong = |cause: &str| format!("buffer view {index} {cause}");
        let view = self.root.buffer_views.get(index).ok_or_else(|| wrong("is not there"))?;
        let buffer = self.buffers.get(view.buffer.value()).ok_or_else(|| wrong("has no buffer"))?;
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let range = start
            .checked_add(view.byte_length.0)
            .and_then(|end| Some(usize::try_from(start).ok()?..usize::try_from(end).ok()?));
        let bytes = range
            .and_then(|range| buffer.get(range))
            .ok_or_else(|| wrong("reaches beyond the end of its buffer"))?;
        Ok((bytes, view.byte_stride.map(|stride| stride.0).filter(|&stride| stride > 0)))
    }

    /// Number and name of a mesh, for messages.
    pub(crate) fn mesh_name(&self, index: usize) -> String {
        let name = self.root.meshes.get(index).and_then(|mesh| mesh.name.as_deref());
        name.map_or_else(|| format!("mesh {index}"), |name| format!("mesh {index} `{name}`"))
    }

    /// A fault at `place` in this file.
    pub(crate) fn malformed(&self, place: impl Into<String>, cause: impl Into<String>) -> SceneError {
        SceneError::Malformed { file: self.file.to_owned(), place: place.into(), cause: cause.into() }
    }

    /// A bound that this file exceeds.
    pub(crate) fn limit(&self, what: &'static str, amount: u64, limit: u64) -> SceneError {
        SceneError::Limit { file: self.file.to_owned(), what, amount, limit }
    }
}

fn parse<T: serde::de::DeserializeOwned>(file: &str, text: &[u8]) -> Result<T, SceneError> {
    json::deserialize::from_slice(text).map_err(|error: json::Error| {
        let file = file.to_owned();
        if error.is_eof() {
            SceneError::Truncated { file, cause: format!("its JSON ends early: {error}") }
        } else if error.is_data() {
            SceneError::Malformed { file, place: "JSON".to_owned(), cause: error.to_string() }
        } else {
            SceneError::NotGltf { file, cause: format!("its JSON cannot be read: {error}") }
        }
    })
}
