//! Images to textures: each image is decoded once a sampler, and counted against the texel limit.
//!
//! Only images that a base colour or an emission uses are decoded; normal maps and the like are never opened.

use crate::document::Document;
use crate::texture::linear_of_srgb;
use crate::{SceneError, Texture, Wrap, extensions, resource};
use gltf::json::texture::{MagFilter, Sampler, WrappingMode};
use gltf::json::validation::Checked;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Longest side of an image, in texels.
const SIDE_MAX: u32 = 16_384;

/// Extensions that give a texture its image in another format.
const OTHER_FORMATS: &[&str] =
    &["KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds"];

type Key = (usize, [Wrap; 2], bool);

/// The textures made so far.
#[derive(Debug)]
pub(crate) struct Images<'a> {
    document: &'a Document<'a>,
    texel_limit: u64,
    texel_count: u64,
    by_key: BTreeMap<Key, usize>,
    mean_blue: BTreeMap<usize, f32>,
    ranges: Vec<Range>,
    /// What the scene will own.
    pub(crate) textures: Vec<Texture>,
    /// Textures that name no image.
    pub(crate) without_image: u64,
}

/// Extremes of a texture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Range {
    /// Most linear red, green and blue of any texel.
    pub(crate) brightest: [f32; 3],
    /// Least alpha of any texel.
    pub(crate) least_alpha: f32,
}

impl Range {
    /// Of a material without a texture.
    pub(crate) const WHITE: Self = Self { brightest: [1.0; 3], least_alpha: 1.0 };
}

impl<'a> Images<'a> {
    pub(crate) fn new(document: &'a Document<'a>, texel_limit: u64) -> Self {
        Self {
            document,
            texel_limit,
            texel_count: 0,
            by_key: BTreeMap::new(),
            mean_blue: BTreeMap::new(),
            ranges: Vec::new(),
            textures: Vec::new(),
            without_image: 0,
        }
    }

    /// Index of the texture that glTF texture `index` becomes; `None` where that names no image.
    ///
    /// # Errors
    /// A missing, unreadable or oversized image.
    pub(crate) fn texture(&mut self, index: usize) -> Result<Option<usize>, SceneError> {
        let document = self.document;
        let wrong = |cause: &str| document.malformed(format!("texture {index}"), cause);
        let Some(image) = self.image_of(index)? else {
            self.without_image += 1;
            return Ok(None);
        };
        let sampler = match document.root.textures[index].sampler {
            Some(sampler) => {
                let found = document.root.samplers.get(sampler.value());
                found.cloned().ok_or_else(|| wrong("its sampler is not there"))?
            }
            None => Sampler::default(),
        };
        let wrap = [wrap_of(sampler.wrap_s), wrap_of(sampler.wrap_t)];
        let nearest = matches!(sampler.mag_filter, Some(Checked::Valid(MagFilter::Nearest)));
        let key = (image, wrap, nearest);
        if let Some(&known) = self.by_key.get(&key) {
            return Ok(Some(known));
        }
        let (width, height, texels) = self.texels(image)?;
        self.ranges.push(Range::of(&texels));
        self.textures.push(Texture { width, height, texels, wrap, nearest, transform: Texture::IDENTITY });
        self.by_key.insert(key, self.textures.len() - 1);
        Ok(Some(self.textures.len() - 1))
    }

    /// Extremes of a texture that [`Self::texture`] made.
    pub(crate) fn range(&self, texture: Option<usize>) -> Range {
        texture.and_then(|texture| self.ranges.get(texture)).copied().unwrap_or(Range::WHITE)
    }

    /// Mean of the blue channel of glTF texture `index`, which holds metalness; 1 where that names no image.
    ///
    /// # Errors
    /// As [`Self::texture`].
    pub(crate) fn mean_blue(&mut self, index: usize) -> Result<f32, SceneError> {
        let Some(image) = self.image_of(index)? else {
            return Ok(1.0);
        };
        if let Some(&known) = self.mean_blue.get(&image) {
            return Ok(known);
        }
        let decoded = self.decode(image)?;
        let sum: u64 = decoded.pixels().map(|texel| u64::from(texel.0[2])).sum();
        let texels = f64::from(decoded.width()) * f64::from(decoded.height());
        let mean = (sum as f64 / (255.0 * texels.max(1.0))) as f32;
        self.mean_blue.insert(image, mean);
        Ok(mean)
    }

    fn image_of(&self, index: usize) -> Result<Option<usize>, SceneError> {
        let document = self.document;
        let wrong = |cause: &str| document.malformed(format!("texture {index}"), cause);
        let texture = document.root.textures.get(index).ok_or_else(|| wrong("it is not there"))?;
        let image = texture.source.value();
        if image < document.root.images.len() {
            return Ok(Some(image));
        }
        // The JSON reader has this value for a source that is left out.
        if image != u32::MAX as usize {
            return Err(wrong("its image is not there"));
        }
        let others = texture.extensions.as_ref().map(|known| &known.others);
        match others.and_then(|others| OTHER_FORMATS.iter().find(|&&name| others.contains_key(name))) {
            Some(name) => Err(extensions::unsupported(document.file, name)),
            None => Ok(None),
        }
    }

    fn texels(&mut self, image: usize) -> Result<(u32, u32, Vec<[u8; 4]>), SceneError> {
        // The same image under another sampler is copied rather than decoded again.
        let least = (image, [Wrap::Repeat; 2], false);
        let twin = self.by_key.range(least..).next().filter(|(key, _)| key.0 == image);
        let (width, height, texels) = if let Some((_, &twin)) = twin {
            let twin = &self.textures[twin];
            (twin.width, twin.height, twin.texels.clone())
        } else {
            let decoded = self.decode(image)?;
            let (width, height) = decoded.dimensions();
            (width, height, decoded.as_raw().as_chunks().0.to_vec())
        };
        self.texel_count += texels.len() as u64;
        if self.texel_count > self.texel_limit {
            return Err(self.document.limit("texels", self.texel_count, self.texel_limit));
        }
        Ok((width, height, texels))
    }

    fn decode(&self, index: usize) -> Result<image::RgbaImage, SceneError> {
        let document = self.document;
        let file = || document.file.to_owned();
        let image = &document.root.images[index];
        let (name, bytes) = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                let name = resource::shown(uri);
                let bytes = resource::fetch(uri, document.folder)
                    .map_err(|cause| SceneError::MissingTexture { file: file(), uri: name.clone(), cause })?;
                (name, Cow::Owned(bytes))
            }
            (None, Some(view)) => {
                let wrong = |cause| document.malformed(format!("image {index}"), cause);
                (index.to_string(), Cow::Borrowed(document.view(view.value()).map_err(wrong)?.0))
            }
            (None, None) => {
                let cause = "it has neither an address nor a buffer view".to_owned();
                return Err(SceneError::MissingTexture { file: file(), uri: index.to_string(), cause });
            }
        };
        let bad = |cause: String| SceneError::BadImage { file: file(), image: name.clone(), cause };
        // By content: exporters get names and MIME types wrong.
        let format = image::guess_format(&bytes).ok();
        let format = format.filter(|f| matches!(f, image::ImageFormat::Png | image::ImageFormat::Jpeg));
        let format = format.ok_or_else(|| bad("it is neither PNG nor JPEG".to_owned()))?;
        let mut reader = image::ImageReader::with_format(std::io::Cursor::new(&*bytes), format);
        let mut limits = image::Limits::default();
        limits.max_image_width = Some(SIDE_MAX);
        limits.max_image_height = Some(SIDE_MAX);
        limits.max_alloc = Some(self.texel_limit.saturating_mul(8));
        reader.limits(limits);
        let decoded = reader.decode().map_err(|error| bad(error.to_string()))?;
        Ok(decoded.into_rgba8())
    }
}

impl Range {
    fn of(texels: &[[u8; 4]]) -> Self {
        let mut most = [0; 3];
        let mut least_alpha = 255;
        for &[red, green, blue, alpha] in texels {
            most = [most[0].max(red), most[1].max(green), most[2].max(blue)];
            least_alpha = least_alpha.min(alpha);
        }
        Self { brightest: most.map(linear_of_srgb), least_alpha: f32::from(least_alpha) / 255.0 }
    }
}

fn wrap_of(mode: Checked<WrappingMode>) -> Wrap {
    match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::ClampToEdge,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::MirroredRepeat,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    }
}
