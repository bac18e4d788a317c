"""Videos of a policy's episodes."""
