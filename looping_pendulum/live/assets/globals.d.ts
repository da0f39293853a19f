/** The script `theme.js` of all pages. */
declare const Theme: { colour(value: string): string; onChange(listener: () => void): void; printing: boolean };
