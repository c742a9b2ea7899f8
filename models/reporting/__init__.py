"""What commands that write reports share: tables, figures, folders."""
