"""The version of this program: written here alone, read by the package's metadata too."""

VERSION = "0.1.0"
