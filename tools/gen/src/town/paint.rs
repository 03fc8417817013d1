//! What a town is made of: diffuse reflectances, and the lamps that emit.

use crate::material::{Material, MaterialId};
use earthshine_world::Rgb;

macro_rules! paints {
    ($($variant:ident $name:literal ($r:literal, $g:literal, $b:literal) $(emits ($lr:literal, $lg:literal, $lb:literal))?;)*) => {
        /// A material of a town.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(u16)]
        pub(crate) enum Paint { $($variant,)* }

        /// All materials, in the order of their numbers.
        pub(crate) fn materials() -> Vec<Material> {
            vec![$(Material {
                $(emitted_radiance: Rgb::new($lr, $lg, $lb),)?
                ..Material::reflecting($name, Rgb::new($r, $g, $b))
            },)*]
        }
    };
}

paints! {
    Asphalt "asphalt" (0.09, 0.09, 0.095);
    Pavement "pavement" (0.34, 0.33, 0.31);
    Paving "paving" (0.42, 0.38, 0.32);
    Sett "sett" (0.28, 0.27, 0.26);
    Marking "road marking" (0.75, 0.75, 0.72);
    Lawn "lawn" (0.1, 0.19, 0.05);
    Soil "soil" (0.12, 0.09, 0.06);
    Stone "stone" (0.45, 0.43, 0.4);
    Chimney "chimney brick" (0.35, 0.15, 0.1);
    FacadeCream "facade cream" (0.74, 0.66, 0.5);
    FacadeOchre "facade ochre" (0.66, 0.47, 0.18);
    FacadeBrick "facade brick" (0.45, 0.18, 0.12);
    FacadeRose "facade rose" (0.7, 0.42, 0.38);
    FacadeSage "facade sage" (0.42, 0.52, 0.36);
    FacadeBlue "facade blue" (0.3, 0.44, 0.6);
    FacadeGrey "facade grey" (0.4, 0.4, 0.41);
    FacadeWhite "facade white" (0.82, 0.81, 0.78);
    RoofRed "roof tiles red" (0.42, 0.14, 0.08);
    RoofSlate "roof slate" (0.13, 0.14, 0.16);
    RoofBrown "roof tiles brown" (0.27, 0.16, 0.1);
    RoofFelt "roof felt" (0.18, 0.18, 0.18);
    WallWhite "wall white" (0.8, 0.79, 0.76);
    WallYellow "wall yellow" (0.76, 0.66, 0.36);
    WallGreen "wall green" (0.45, 0.6, 0.42);
    WallBlue "wall blue" (0.4, 0.52, 0.68);
    WallRed "wall red" (0.58, 0.24, 0.2);
    Ceiling "ceiling" (0.83, 0.83, 0.82);
    Boards "floor boards" (0.4, 0.25, 0.14);
    FloorTiles "floor tiles" (0.5, 0.46, 0.4);
    Carpet "carpet" (0.3, 0.12, 0.14);
    FrameWhite "window frame" (0.78, 0.78, 0.76);
    Wood "wood" (0.36, 0.22, 0.11);
    Linen "linen" (0.72, 0.72, 0.75);
    Bark "bark" (0.16, 0.11, 0.07);
    LeafLight "leaf light" (0.16, 0.3, 0.07);
    LeafDark "leaf dark" (0.06, 0.16, 0.05);
    Needle "needle" (0.04, 0.11, 0.05);
    Iron "iron" (0.07, 0.07, 0.08);
    Glass "car glass" (0.06, 0.07, 0.08);
    CarRed "car red" (0.55, 0.06, 0.05);
    CarBlue "car blue" (0.08, 0.16, 0.45);
    CarWhite "car white" (0.78, 0.78, 0.78);
    CarGreen "car green" (0.1, 0.3, 0.16);
    CanvasRed "canvas red" (0.66, 0.1, 0.08);
    CanvasBlue "canvas blue" (0.12, 0.25, 0.6);
    CanvasYellow "canvas yellow" (0.8, 0.62, 0.12);
    FruitOrange "oranges" (0.75, 0.34, 0.04);
    FruitGreen "apples" (0.4, 0.55, 0.1);
    FruitRed "tomatoes" (0.6, 0.08, 0.05);
    Water "water" (0.05, 0.09, 0.1);
    StreetLamp "street lamp" (0.5, 0.5, 0.5) emits (2500.0, 2000.0, 1400.0);
    RoomLamp "room lamp" (0.6, 0.6, 0.6) emits (3000.0, 2500.0, 1900.0);
}

impl Paint {
    pub(crate) const FACADES: [Self; 8] = [
        Self::FacadeCream,
        Self::FacadeOchre,
        Self::FacadeBrick,
        Self::FacadeRose,
        Self::FacadeSage,
        Self::FacadeBlue,
        Self::FacadeGrey,
        Self::FacadeWhite,
    ];
    /// Of pitched roofs.
    pub(crate) const ROOFS: [Self; 3] = [Self::RoofRed, Self::RoofSlate, Self::RoofBrown];
    pub(crate) const WALLS: [Self; 5] =
        [Self::WallWhite, Self::WallYellow, Self::WallGreen, Self::WallBlue, Self::WallRed];
    pub(crate) const FLOORS: [Self; 3] = [Self::Boards, Self::FloorTiles, Self::Carpet];

    pub(crate) const fn id(self) -> MaterialId {
        MaterialId(self as u16)
    }
}
