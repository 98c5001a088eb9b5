"""What is changed of how viser draws its widgets."""

STYLE_SHEET = """<style>
p.mantine-Text-root[style*="letter-spacing"], .mantine-Input-input { letter-spacing: 0 !important; }
.mantine-Paper-root[data-with-border="true"]:has(> .mantine-Paper-root) {
  border-width: 1px 0 0 0 !important; border-color: rgba(128, 128, 128, .3) !important; border-radius: 0 !important;
  margin: .2em .6em 0 .6em !important; padding: 0 !important; }
.mantine-Paper-root[data-with-border="true"] > .mantine-Paper-root {
  position: static !important; transform: none !important; display: flex !important; width: 100%;
  justify-content: space-between; align-items: center; background: none !important; margin: 0 !important;
  padding: .45em .1em .35em .1em !important; font-weight: 600; }
.mantine-Paper-root[data-with-border="true"] > .mantine-Paper-root:hover { opacity: .8; }
.mantine-Paper-root[data-with-border="true"] > div > div { padding-top: 0 !important; }
.mantine-Paper-root[data-with-border="true"] > div > div > div > div { padding-inline: 0 !important; margin-inline: 0 !important; }
[role="tab"][data-dock-tab] { padding: 0 .55em !important; }
.multi-slider { margin-inline: 6px 12px; width: calc(100% - 18px) !important; }
.mantine-ScrollArea-viewport > .mantine-ScrollArea-content { padding-right: 6px; }
.mantine-Slider-mark, .mantine-Slider-markWrapper > .mantine-Slider-mark { opacity: .35; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) { width: calc(100vw - 684px) !important; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-picture) { width: calc(100vw - 684px) !important; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) [role="tablist"] { display: none !important; }
</style>"""
