//! Why a scene or a lights file was refused: each error names the file, the cause and the cure.
//!
//! Not here: what is merely skipped or changed, which [`crate::ImportReport`] counts.

/// A scene or lights file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// There is no such file.
    #[error("{file}: there is no such file; check the path")]
    NotFound {
        /// As asked for.
        file: String,
    },
    /// The operating system refused.
    #[error("{file}: cannot be read: {source}")]
    Io {
        /// As asked for.
        file: String,
        /// What it said.
        source: std::io::Error,
    },
    /// Another format, or another version of glTF.
    #[error("{file}: not glTF 2.0: {cause}; export the scene as .glb or .gltf, version 2.0")]
    NotGltf {
        /// Which file.
        file: String,
        /// What gives it away.
        cause: String,
    },
    /// The file ends too early.
    #[error("{file}: truncated: {cause}; copy or export it again")]
    Truncated {
        /// Which file.
        file: String,
        /// What is cut.
        cause: String,
    },
    /// A value or reference that glTF does not allow.
    #[error("{file}: {place}: {cause}; export it again (`gltf-transform validate` lists every fault)")]
    Malformed {
        /// Which file.
        file: String,
        /// Where in it, such as `accessor 12`.
        place: String,
        /// What is wrong there.
        cause: String,
    },
    /// A buffer beside the file is not there or too short.
    #[error("{file}: buffer {uri}: {cause}; put it back at that path, relative to the .gltf file")]
    MissingBuffer {
        /// Which file.
        file: String,
        /// As the file names it, shortened.
        uri: String,
        /// Why it cannot be had.
        cause: String,
    },
    /// An image is not there.
    #[error("{file}: texture image {uri}: {cause}; put it back at that path, relative to the .gltf file")]
    MissingTexture {
        /// Which file.
        file: String,
        /// As the file names it, shortened.
        uri: String,
        /// Why it cannot be had.
        cause: String,
    },
    /// An image is there and cannot be decoded.
    #[error("{file}: texture image {image}: {cause}; save it as PNG or JPEG")]
    BadImage {
        /// Which file.
        file: String,
        /// Its number or address.
        image: String,
        /// What the decoder says.
        cause: String,
    },
    /// A triangle asks for a vertex that the mesh does not have.
    #[error(
        "{file}: {mesh}, primitive {primitive}: a triangle uses vertex {index} of {vertices}; export it again"
    )]
    IndexOutOfRange {
        /// Which file.
        file: String,
        /// Number and name of the mesh.
        mesh: String,
        /// Which of the mesh's primitives.
        primitive: usize,
        /// The vertex asked for.
        index: u64,
        /// How many there are.
        vertices: u64,
    },
    /// A used vertex has no place in the world.
    #[error(
        "{file}: {mesh}, primitive {primitive}: vertex {vertex} is not finite; \
         repair the mesh (often a division by zero while exporting) and export it again"
    )]
    NotFinite {
        /// Which file.
        file: String,
        /// Number and name of the mesh.
        mesh: String,
        /// Which of the mesh's primitives.
        primitive: usize,
        /// Which vertex.
        vertex: u64,
    },
    /// Nothing to bake.
    #[error("{file}: no triangles: {cause}; export meshes, and see that the default scene holds them")]
    NoTriangles {
        /// Which file.
        file: String,
        /// What was there instead.
        cause: String,
    },
    /// The file needs an extension that would change what is seen.
    #[error("{file}: uses the extension {name}, which is not supported; {cure}")]
    UnsupportedExtension {
        /// Which file.
        file: String,
        /// The extension.
        name: String,
        /// What to do, with the command that converts the file where there is one.
        cure: String,
    },
    /// More than a bound that keeps memory in hand.
    #[error("{file}: {amount} {what}, more than the limit of {limit}; split or simplify the scene")]
    Limit {
        /// Which file.
        file: String,
        /// What is counted.
        what: &'static str,
        /// How many there are, at least.
        amount: u64,
        /// How many there may be.
        limit: u64,
    },
    /// A lights file, or the lights inside a glTF file, hold something that cannot be.
    #[error("{file}: {entry}: {cause}")]
    BadLights {
        /// Which file.
        file: String,
        /// Which light, or the sky.
        entry: String,
        /// What is wrong, and what is expected.
        cause: String,
    },
}

impl SceneError {
    /// What the operating system says about `file`.
    pub(crate) fn io(file: &str, source: std::io::Error) -> Self {
        let file = file.to_owned();
        match source.kind() {
            std::io::ErrorKind::NotFound => Self::NotFound { file },
            _ => Self::Io { file, source },
        }
    }
}
