// Colours, light and dark. Where they mean something they differ in lightness as well, and forms differ too, for those who see colours otherwise.

const hex = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16) / 255);

const PALETTES = {
    light: {
        horizon: hex('#e6ebee'),
        ground: hex('#eceeed'),
        grid: hex('#cdd3d6'),
        building: hex('#f3f0ea'),
        obstacle: hex('#e8b06a'),
        terrain: hex('#dfe3dc'),
        edge: hex('#6f767f'),
        edgeOpacity: 0.42,
        waiting: hex('#aab3bb'),
        selected: hex('#ffd36e'),
        added: hex('#8fd3bd'),
        changed: hex('#b79df2'),
        gone: hex('#c8442b'),
        zone: hex('#c8442b'),
        ceiling: hex('#5d7fa3'),
        slowToFast: ['#5b1a9e', '#a01a9c', '#d2466f', '#f2834c', '#f5a623'].map(hex),
        earlyToLate: ['#3b049a', '#98189e', '#dc5d68', '#f2834c', '#fcb031'].map(hex),
        other: hex('#3f6f9f'),
        drone: hex('#16191d'),
        casing: hex('#ffffff'),
        frustum: hex('#16191d'),
        selectedImage: hex('#1f5f99'),
        otherImage: hex('#9aa2ab'),
    },
    dark: {
        horizon: hex('#1d242d'),
        ground: hex('#171c23'),
        grid: hex('#2b333d'),
        building: hex('#5a636f'),
        obstacle: hex('#a8733a'),
        terrain: hex('#333c3a'),
        edge: hex('#aeb9c6'),
        edgeOpacity: 0.34,
        waiting: hex('#8d98a5'),
        selected: hex('#d9a83a'),
        added: hex('#3f9a80'),
        changed: hex('#7a68b8'),
        gone: hex('#ec7a61'),
        zone: hex('#e0624a'),
        ceiling: hex('#7fa3c9'),
        slowToFast: ['#a65bea', '#d652c9', '#f0708f', '#fb9a62', '#ffd166'].map(hex),
        earlyToLate: ['#8d63e6', '#c659c9', '#ef7286', '#fb9a62', '#ffd166'].map(hex),
        other: hex('#6fb1ea'),
        drone: hex('#ffffff'),
        casing: hex('#0d1116'),
        frustum: hex('#ffffff'),
        selectedImage: hex('#8cc4f5'),
        otherImage: hex('#6a737e'),
    },
};

// What is captured.
export const COVERAGE = {
    captured: hex('#2673b2'),
    nothing: hex('#d73027'),
    halfway: hex('#d7e145'),
    beyond: hex('#808080'),
    gained: hex('#1b9e77'),
    lost: hex('#d95f02'),
};

const dark = window.matchMedia('(prefers-color-scheme: dark)');
let chosen = null;

export const themeName = () => chosen ?? (dark.matches ? 'dark' : 'light');
export const palette = () => PALETTES[themeName()];
export const cssColour = (colour) => `rgb(${colour.map((value) => Math.round(255 * value)).join(' ')})`;

export function chooseTheme(name, onChange) {
    chosen = name;
    document.documentElement.dataset.theme = themeName();
    onChange();
}

export function followTheme(onChange) {
    document.documentElement.dataset.theme = themeName();
    dark.addEventListener('change', () => {
        if (chosen === null) chooseTheme(null, onChange);
    });
}

export const movesLittle = () => window.matchMedia('(prefers-reduced-motion: reduce)').matches;
